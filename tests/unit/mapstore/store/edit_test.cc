// SPDX-License-Identifier: Apache-2.0
//
// Edits in a store: the versions they make, the rows that follow them, and taking them back.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <string>
#include <vector>

#include "mapstore/maintenance/compact.h"
#include "mapstore/maintenance/verify.h"
#include "mapstore/map_store.h"
#include "mapstore/sqlite/database.h"
#include "mapstore/sqlite/row_checksum.h"
#include "tests/support/geometry_matchers.h"
#include "tests/support/random_map.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/mapstore/store/store_test_util.h"

namespace shiftmap::testing {
namespace {

using ::testing::IsEmpty;
using ::testing::SizeIs;

class EditTest : public ::testing::Test {
 protected:
  EditTest() {
    std::mt19937_64 random(TestSeed(21));
    content_ =
        RandomContent(random, {.groups = 3, .anonymous_landmarks = 0, .vehicles = 1, .rhythms = 2});
    content_.stamp = At(0.0);
    content_.vehicles[0].stamp = At(-100.0);
    for (LandmarkGroup& group : content_.groups) {
      group.chain = ModeChain::Uniform(static_cast<int>(group.modes.size()), 1e-5);
    }
    CommitOptions options;
    options.states_probabilities = false;
    first_ = *store_.Commit("floor", content_, {"test", "", 0, {}}, options);
  }

  const std::string& NameOf(std::size_t group) const {
    return content_.groups[group].signature.text();
  }

  MapEdit Make(EditKind kind, std::size_t group) const {
    MapEdit edit;
    edit.kind = kind;
    edit.author = "surveyor";
    edit.reason = "test";
    edit.signature = content_.groups[group].signature;
    return edit;
  }

  MapEdit Control() const {
    MapEdit edit = Make(EditKind::kControl, 1);
    edit.mode = ModeNumber(1);
    edit.p_map_landmark = {50.0, 60.0};
    edit.sd_m = 0.02;
    return edit;
  }

  MapEdit Rename(std::size_t group, const std::string& name) const {
    MapEdit edit = Make(EditKind::kRename, group);
    edit.new_name = Signature(name);
    return edit;
  }

  MapEdit Placed(std::size_t group) const {
    MapEdit edit = Make(EditKind::kPosition, group);
    edit.mode = ModeNumber(1);
    edit.p_map_landmark = {5.0, 6.0};
    edit.sd_m = 0.02;
    return edit;
  }

  // A report of one visit that finds a landmark at its first mode.
  ShiftReport Report(const CommitResult& version, const std::string& name, double at) {
    ShiftReport report = EmptyReport(version, "floor", ++reports_);
    VisitEvidence visit = TwoStateEvidence(At(at), At(at + 60.0), -10.0, 0.0);
    visit.signature = Signature(name);
    report.evidence = {visit};
    return report;
  }

  EditResult Edit(const MapEdit& edit) {
    const StatusOr<EditResult> result = store_.Edit("floor", edit);
    EXPECT_THAT(result, IsOk());
    return *result;
  }

  EditResult Undo(EditId id) {
    const StatusOr<EditResult> result = store_.UndoEdit("floor", id, {"surveyor", "a mistake", {}});
    EXPECT_THAT(result, IsOk());
    return *result;
  }

  // A build on the published version that changes nothing.
  CommitResult Build() {
    const VersionNumber parent = **store_.PublishedVersion("floor");
    CommitOptions options;
    options.parent = parent;
    options.states_probabilities = false;
    MapContent content = store_.LoadVersion("floor", parent)->content();
    return *store_.Commit("floor", content, {"test", "", 0, {}}, options);
  }

  const LandmarkGroup* Group(const MapSnapshot& map, const std::string& name) const {
    const int index = map.GroupIndex(Signature(name));
    return index < 0 ? nullptr : &map.groups()[static_cast<std::size_t>(index)];
  }

  double First(const MapSnapshot& map, const std::string& name) const {
    return Group(map, name)->probabilities(1);
  }

  void ExpectClean() {
    const StatusOr<VerifyResult> verified = VerifyStore(path_);
    ASSERT_THAT(verified, IsOk());
    EXPECT_TRUE(verified->clean())
        << verified->defects[0].row << ": " << verified->defects[0].problem;
  }

  void ExpectDefect(const std::string& problem) {
    const StatusOr<VerifyResult> verified = VerifyStore(path_);
    ASSERT_THAT(verified, IsOk());
    ASSERT_FALSE(verified->clean());
    EXPECT_THAT(verified->defects[0].problem, ::testing::HasSubstr(problem));
  }

  // Writes past the store, with checksums that fit.
  void Change(const std::string& sql) {
    StatusOr<Database> database = Database::Open(path_, {Database::Mode::kReadWrite});
    ASSERT_THAT(database->Execute(sql), IsOk());
    ASSERT_THAT(SetChecksums(*database, "map_edit"), IsOk());
  }

  TempDir dir_;
  const std::string path_ = dir_.File("a.db");
  MapStore store_ = OpenStore(path_);
  MapContent content_;
  CommitResult first_;
  int reports_ = 0;
};

TEST_F(EditTest, RowsAndNamesFollowARenameAndItsUndo) {
  const std::string old = NameOf(0);
  ASSERT_THAT(store_.Return(Report(first_, old, 100.0)), IsOk());
  const MapSnapshot before = *store_.LoadAt("floor");
  const EditResult rename = Edit(Rename(0, "gate"));
  ASSERT_TRUE(rename.version);
  const MapSnapshot renamed = *store_.LoadAt("floor");
  EXPECT_EQ(renamed.version(), rename.version->version);
  EXPECT_EQ(Group(renamed, "gate")->probabilities, Group(before, old)->probabilities);
  // The old name still is the landmark's.
  EXPECT_EQ(Group(renamed, old), Group(renamed, "gate"));
  EXPECT_EQ(store_.Evidence("floor", renamed.version())->front().evidence.signature.text(), "gate");

  // A later shift on the renamed map, and one that still drives on the first.
  ASSERT_THAT(store_.Return(Report(*rename.version, "gate", 200.0)), IsOk());
  ASSERT_THAT(store_.Return(Report(first_, old, 300.0)), IsOk());
  EXPECT_THAT(*store_.Evidence("floor", renamed.version()), SizeIs(3));
  const std::vector<ReportSummary> reports = *store_.Reports("floor");
  for (const ReportSummary& report : reports) {
    EXPECT_THAT(report.set_aside, IsEmpty());
  }
  const double believed = First(*store_.LoadAt("floor"), "gate");

  const EditResult undone = Undo(rename.edit);
  ASSERT_TRUE(undone.version);
  EXPECT_EQ(undone.version->content_hash, first_.content_hash);
  const MapSnapshot after = *store_.LoadAt("floor");
  EXPECT_EQ(Group(after, "gate"), nullptr);
  EXPECT_EQ(First(after, old), believed);
  // The first version, which no edit touched, says the same of the same rows.
  EXPECT_EQ(ContentHash(store_.LoadAt("floor", VersionNumber(1))->content()),
            ContentHash(after.content()));
  ExpectClean();
}

TEST_F(EditTest, ARenameHoldsInBuildsAndIsTakenOutOfThem) {
  const std::string old = NameOf(2);
  const EditResult rename = Edit(Rename(2, "gate"));
  const CommitResult built = Build();
  ASSERT_THAT(store_.Return(Report(built, "gate", 200.0)), IsOk());
  const double believed = First(*store_.LoadAt("floor"), "gate");
  const EditResult undone = Undo(rename.edit);
  ASSERT_TRUE(undone.version);
  EXPECT_FALSE(undone.rests_on);
  EXPECT_EQ(undone.version->content_hash, first_.content_hash);
  EXPECT_EQ(First(*store_.LoadAt("floor"), old), believed);
  EXPECT_THAT(*store_.EditsOf("floor", undone.version->version), IsEmpty());
  ExpectClean();
}

TEST_F(EditTest, ANameIsOneLandmarksForEver) {
  const EditResult rename = Edit(Rename(0, "gate"));
  EXPECT_THAT(store_.Edit("floor", Rename(1, "gate")),
              StatusIs(StatusCode::kInvalidArgument, "'gate': is another landmark of the map"));
  EXPECT_THAT(store_.Edit("floor", Rename(1, NameOf(0))),
              StatusIs(StatusCode::kInvalidArgument, "is a former name"));
  ASSERT_THAT(store_.Return(Report(*rename.version, "gate", 100.0)), IsOk());
  Undo(rename.edit);
  EXPECT_THAT(store_.Edit("floor", Rename(1, "gate")),
              StatusIs(StatusCode::kInvalidArgument, "the ledger knows another landmark"));
  EXPECT_THAT(store_.Edit("floor", Rename(0, "gate")), IsOk());
  const EditResult retired = Edit(Make(EditKind::kRetire, 1));
  EXPECT_THAT(store_.Edit("floor", Rename(2, NameOf(1))),
              StatusIs(StatusCode::kInvalidArgument, "is a landmark that was retired"));
  EXPECT_TRUE(retired.version);
}

TEST_F(EditTest, RenamesOfOneLandmarkAreTakenBackInAnyOrder) {
  const EditResult first = Edit(Rename(0, "gate"));
  MapEdit again = Rename(0, "door");
  again.signature = Signature("gate");
  const EditResult second = Edit(again);
  ASSERT_THAT(store_.Return(Report(*second.version, "door", 100.0)), IsOk());
  const double believed = First(*store_.LoadAt("floor"), "door");
  Undo(first.edit);
  EXPECT_EQ(First(*store_.LoadAt("floor"), "door"), believed);
  EXPECT_EQ(Undo(second.edit).version->content_hash, first_.content_hash);
  EXPECT_EQ(First(*store_.LoadAt("floor"), NameOf(0)), believed);
  ExpectClean();
}

// Edits of different landmarks, and a shift on the first version, in every order.
TEST_F(EditTest, OrderDoesNotMatterWhereNothingDependsOnIt) {
  const MapEdit placed = Placed(2);
  const std::vector<MapEdit> edits = {Rename(0, "gate"), Make(EditKind::kRetire, 1), placed};
  const ShiftReport report = Report(first_, NameOf(0), 100.0);
  std::vector<int> order = {0, 1, 2, 3};
  std::string expected;
  do {
    TempDir dir;
    MapStore store = OpenStore(dir.File("a.db"));
    CommitOptions options;
    options.states_probabilities = false;
    ASSERT_THAT(store.Commit("floor", content_, {"test", "", 0, {}}, options), IsOk());
    for (const int step : order) {
      if (step == 3) {
        ASSERT_THAT(store.Return(report), IsOk());
      } else {
        ASSERT_THAT(store.Edit("floor", edits[static_cast<std::size_t>(step)]), IsOk());
      }
    }
    const std::string hash = ContentHash(store.LoadAt("floor")->content());
    if (expected.empty()) expected = hash;
    EXPECT_EQ(hash, expected);
  } while (std::next_permutation(order.begin(), order.end()));
}

TEST_F(EditTest, ARetiredLandmarkHasItsRowsAgainWhenItComesBack) {
  ASSERT_THAT(store_.Return(Report(first_, NameOf(1), 100.0)), IsOk());
  const MapSnapshot before = *store_.LoadAt("floor");
  const EditResult retired = Edit(Make(EditKind::kRetire, 1));
  EXPECT_EQ(Group(*store_.LoadAt("floor"), NameOf(1)), nullptr);
  EXPECT_EQ(store_.Reports("floor")->front().set_aside.front().reason, SetAside::kNoLandmark);
  Undo(retired.edit);
  EXPECT_EQ(ContentHash(store_.LoadAt("floor")->content()), ContentHash(before.content()));
  EXPECT_THAT(store_.Edit("floor", Make(EditKind::kRetire, 1)), IsOk());
  EXPECT_THAT(store_.Edit("floor", Make(EditKind::kRetire, 1)),
              StatusIs(StatusCode::kNotFound, "no landmark '"));
  ExpectClean();
}

// A surveyed position that a build was made with stays in it, and is said to.
TEST_F(EditTest, APositionThatABuildRestsOnIsMarked) {
  const MapEdit edit = Placed(0);
  const EditResult placed = Edit(edit);
  const CommitResult built = Build();
  const EditResult undone = Undo(placed.edit);
  EXPECT_FALSE(undone.version);
  EXPECT_TRUE(undone.rests_on);
  EXPECT_EQ(**store_.PublishedVersion("floor"), built.version);
  const std::vector<MapEdit> held = *store_.EditsOf("floor", built.version);
  ASSERT_THAT(held, SizeIs(1));
  EXPECT_TRUE(held[0].undone);
  EXPECT_THAT(*store_.EditsOf("floor", VersionNumber(1)), IsEmpty());
  ExpectClean();
}

// What goes on from an older version takes the edits in that it does not hold.
TEST_F(EditTest, AnOlderVersionTakesTheEditsInForceIn) {
  const MapEdit placed = Placed(0);
  const EditResult position = Edit(placed);
  const EditResult rename = Edit(Rename(1, "gate"));
  Build();
  Undo(position.edit);
  const StatusOr<VersionNumber> version = store_.WithEditsInForce("floor", VersionNumber(1));
  ASSERT_THAT(version, IsOk());
  EXPECT_NE(*version, VersionNumber(1));
  const MapSnapshot map = *store_.LoadVersion("floor", *version);
  EXPECT_NE(map.GroupIndex(Signature("gate")), -1);
  EXPECT_EQ(Group(map, NameOf(0))->modes[0].p_map_landmark,
            content_.groups[0].modes[0].p_map_landmark);
  EXPECT_EQ(store_.EditsOf("floor", *version)->front().id, rename.edit);
  EXPECT_EQ(*store_.WithEditsInForce("floor", *version), *version);
  EXPECT_NE(**store_.PublishedVersion("floor"), *version);
  ExpectClean();
}

// Two runs met the landmark at what the map has as one place, a third one does not say where.
TEST_F(EditTest, RowsOfASplitModeTellOfThePlaceThatTheirRunIsSaidToHaveMet) {
  const std::string name = NameOf(0);
  std::vector<ShiftReport> reports;
  for (const double at : {100.0, 10'000.0, 20'000.0}) {
    reports.push_back(Report(first_, name, at));
    ASSERT_THAT(store_.Return(reports.back()), IsOk());
  }
  const MapSnapshot before = *store_.LoadAt("floor");
  MapEdit split = Make(EditKind::kSplit, 0);
  split.mode = ModeNumber(1);
  split.p_map_landmark = {1.0, 1.0};
  split.p_map_second = {2.0, 1.0};
  split.sd_m = 0.05;
  split.first_runs = {reports[0].uuid};
  split.second_runs = {reports[1].uuid};
  const EditResult result = Edit(split);
  const MapEdit made = store_.Edits("floor")->front();
  EXPECT_EQ(made.first_runs, std::vector{reports[0].uuid});
  EXPECT_EQ(made.second_runs, std::vector{reports[1].uuid});
  const VersionNumber version = result.version->version;
  const auto at = [&](const MapSnapshot& map, ModeNumber mode) {
    const LandmarkGroup& group = *Group(map, name);
    return group.probabilities(group.StateOf(mode));
  };
  const MapSnapshot first = *store_.LoadAt("floor", version, At(200.0));
  EXPECT_GT(at(first, ModeNumber(1)), 0.9);
  EXPECT_LT(at(first, made.into), 0.1);
  const MapSnapshot second = *store_.LoadAt("floor", version, At(10'100.0));
  EXPECT_LT(at(second, ModeNumber(1)), 0.1);
  EXPECT_GT(at(second, made.into), 0.9);
  // The third one says that it is at one of the two, and the chain says which.
  const MapSnapshot third = *store_.LoadAt("floor", version, At(20'100.0));
  EXPECT_GT(at(third, ModeNumber(1)) + at(third, made.into), 0.99);
  EXPECT_GT(at(third, made.into), at(third, ModeNumber(1)));
  // What chains are learned from says the same, and so does the landmark's history.
  const std::vector<EvidenceRow> rows = *store_.Evidence("floor", version);
  ASSERT_EQ(rows.size(), 3U);
  const auto value = [](const VisitEvidence& visit, ModeNumber mode) {
    for (const auto& of : visit.modes) {
      if (of.mode == mode) return of.log_likelihood;
    }
    return 99.0;
  };
  EXPECT_EQ(value(rows[0].evidence, ModeNumber(1)), 0.0);
  EXPECT_EQ(value(rows[0].evidence, made.into), -10.0);
  EXPECT_EQ(value(rows[1].evidence, ModeNumber(1)), -10.0);
  EXPECT_EQ(value(rows[1].evidence, made.into), 0.0);
  EXPECT_EQ(value(rows[2].evidence, ModeNumber(1)), 0.0);
  EXPECT_EQ(value(rows[2].evidence, made.into), 0.0);
  const LandmarkRecords records = *store_.LoadLandmark("floor", Signature(name), {});
  EXPECT_EQ(value(records.visits[1].evidence, made.into), 0.0);
  ExpectClean();

  // A snapshot has the same, and the versions before are as they were.
  const std::string snapshot_path = dir_.File("snapshot.db");
  ASSERT_THAT(store_.ExportSnapshot("floor", snapshot_path), IsOk());
  MapStore snapshot = *MapStore::Open(snapshot_path, MapStore::Access::kReadOnly);
  EXPECT_EQ(Group(*snapshot.LoadAt("floor"), name)->probabilities,
            Group(*store_.LoadAt("floor"), name)->probabilities);
  EXPECT_EQ(Group(*store_.LoadAt("floor", first_.version), name)->probabilities,
            Group(before, name)->probabilities);
  Undo(result.edit);
  EXPECT_EQ(Group(*store_.LoadAt("floor"), name)->probabilities,
            Group(before, name)->probabilities);
  ExpectClean();

  split.second_runs = split.first_runs;
  EXPECT_THAT(store_.Edit("floor", split),
              StatusIs(StatusCode::kInvalidArgument, "is said of both places, expected one"));
  split.second_runs = {"nobody"};
  EXPECT_THAT(store_.Edit("floor", split), StatusIs(StatusCode::kNotFound, "no run 'nobody'"));
}

// Half of what an import states of a mode is each place's.
TEST_F(EditTest, AStatementBeforeASplitIsSharedByBothPlaces) {
  CommitOptions options;
  options.parent = VersionNumber(1);
  options.states_probabilities = true;
  ASSERT_THAT(store_.Commit("floor", content_, {"import", "", 0, {}}, options), IsOk());
  Build();
  MapEdit split = Make(EditKind::kSplit, 0);
  split.mode = ModeNumber(1);
  split.p_map_landmark = {1.0, 1.0};
  split.p_map_second = {2.0, 1.0};
  split.sd_m = 0.05;
  Edit(split);
  const MapSnapshot map = *store_.LoadAt("floor", std::nullopt, At(0.0));
  const LandmarkGroup& group = *Group(map, NameOf(0));
  const double stated = content_.groups[0].probabilities(1);
  EXPECT_NEAR(group.probabilities(1), 0.5 * stated, 1e-9);
  EXPECT_NEAR(
      group.probabilities(group.StateOf(store_.Edits("floor")->front().into)), 0.5 * stated, 1e-9);
  ExpectClean();
}

TEST_F(EditTest, EditsAreTakenBackInAnyOrderUnlessOneNeedsAnother) {
  MapEdit added = Make(EditKind::kNewMode, 0);
  added.p_map_landmark = {1.0, 1.0};
  added.sd_m = 0.1;
  const EditResult mode = Edit(added);
  MapEdit moved = Make(EditKind::kPosition, 0);
  moved.mode = store_.Edits("floor")->front().mode;
  moved.p_map_landmark = {2.0, 2.0};
  moved.sd_m = 0.1;
  const EditResult position = Edit(moved);
  EXPECT_THAT(store_.UndoEdit("floor", mode.edit, {"surveyor", "test", {}}),
              StatusIs(StatusCode::kFailedPrecondition, "edit 1: another one needs it: edit 2"));
  Undo(position.edit);
  Undo(mode.edit);
  const MapSnapshot map = *store_.LoadAt("floor");
  EXPECT_EQ(Group(map, NameOf(0))->modes.size(), content_.groups[0].modes.size());
  ExpectClean();
}

TEST_F(EditTest, DamageIsNoEditThatAnotherOneNeeds) {
  const EditResult retired = Edit(Make(EditKind::kRetire, 0));
  StatusOr<Database> database = Database::Open(path_, {Database::Mode::kReadWrite});
  ASSERT_THAT(database->Execute("UPDATE mode SET x_m = x_m + 1"), IsOk());
  EXPECT_THAT(store_.UndoEdit("floor", retired.edit, {"surveyor", "test", {}}),
              StatusIs(StatusCode::kDataLoss, ""));
}

TEST_F(EditTest, WhatCannotBeDoneIsRefusedAndLeavesNothing) {
  const auto undo = [&](int id, const std::string& reason) {
    return store_.UndoEdit("floor", EditId(id), {"surveyor", reason, {}});
  };
  MapEdit edit = Make(EditKind::kRetire, 0);
  edit.signature = Signature("\x1b[31mnobody");
  EXPECT_THAT(store_.Edit("floor", edit),
              StatusIs(StatusCode::kNotFound, "no landmark '\\x1b[31mnobody'"));
  edit.reason = "";
  EXPECT_THAT(store_.Edit("floor", edit), StatusIs(StatusCode::kInvalidArgument, "reason: empty"));
  EXPECT_THAT(store_.Edit("roof", Make(EditKind::kRetire, 0)),
              StatusIs(StatusCode::kNotFound, "no area 'roof'"));
  EXPECT_THAT(undo(1, "test"), StatusIs(StatusCode::kNotFound, "no edit 1"));
  EXPECT_THAT(store_.Edit("floor", Make(EditKind::kRetire, 0), true), IsOk());
  EXPECT_THAT(*store_.Edits("floor"), IsEmpty());
  EXPECT_THAT(*store_.Versions("floor"), SizeIs(1));
  const EditResult retired = Edit(Make(EditKind::kRetire, 0));
  EXPECT_THAT(undo(1, ""), StatusIs(StatusCode::kInvalidArgument, "reason: empty"));
  Undo(retired.edit);
  EXPECT_THAT(undo(1, "test"), StatusIs(StatusCode::kAlreadyExists, "taken back already"));
}

TEST_F(EditTest, EditsAreInTheAuditLogWithTheirReasons) {
  const EditResult retired = Edit(Make(EditKind::kRetire, 0));
  Undo(retired.edit);
  std::vector<std::string> actions;
  const std::vector<AuditEntry> audit = *store_.AuditLog("floor");
  for (const AuditEntry& entry : audit) {
    actions.push_back(entry.action + " " + entry.subject);
  }
  const std::vector<std::string> expected = {
      "edit 1: retire '" + NameOf(0) + "': test (surveyor)",
      "undo 1: retire '" + NameOf(0) + "': a mistake (surveyor)",
      "publish 3"};
  EXPECT_THAT(actions, ::testing::IsSupersetOf(expected));
}

TEST_F(EditTest, ASnapshotHoldsEditsAndFollowsNames) {
  ASSERT_THAT(store_.Return(Report(first_, NameOf(0), 100.0)), IsOk());
  Edit(Rename(0, "gate"));
  Edit(Control());
  Build();
  const std::string path = dir_.File("snapshot.db");
  ASSERT_THAT(store_.ExportSnapshot("floor", path), IsOk());
  MapStore snapshot = *MapStore::Open(path, MapStore::Access::kReadOnly);
  const MapSnapshot map = *snapshot.LoadAt("floor");
  EXPECT_EQ(ContentHash(map.content()), ContentHash(store_.LoadAt("floor")->content()));
  EXPECT_NE(map.GroupIndex(Signature(NameOf(0))), -1);
  EXPECT_THAT(Group(map, NameOf(1))->modes[0].p_map_landmark,
              IsNearMatrix(Eigen::Vector2d(50.0, 60.0), 1e-9));
  EXPECT_TRUE(VerifyStore(path)->clean());
  EXPECT_THAT(snapshot.Edit("floor", Rename(0, "door"), true),
              StatusIs(StatusCode::kFailedPrecondition, "is a snapshot"));
}

// What an import states goes with the renamed landmark, in the version that is edited and in
// builds.
TEST_F(EditTest, StatementsFollowNames) {
  MapContent stated = content_;
  stated.stamp = At(1.0);
  CommitOptions options;
  options.parent = first_.version;
  ASSERT_THAT(store_.Commit("floor", stated, {"import", "", 0, {}}, options), IsOk());
  const MapSnapshot before = *store_.LoadAt("floor");
  const EditResult rename = Edit(Rename(0, "gate"));
  EXPECT_EQ(Group(*store_.LoadAt("floor"), "gate")->probabilities,
            Group(before, NameOf(0))->probabilities);
  Build();
  EXPECT_THAT(Group(*store_.LoadAt("floor"), "gate")->probabilities,
              IsNearMatrix(Group(before, NameOf(0))->probabilities, 1e-12));
  Undo(rename.edit);
  EXPECT_THAT(Group(*store_.LoadAt("floor"), NameOf(0))->probabilities,
              IsNearMatrix(Group(before, NameOf(0))->probabilities, 1e-12));
  ExpectClean();
}

TEST_F(EditTest, CompactingKeepsWhatEditsNeed) {
  const EditResult retired = Edit(Make(EditKind::kRetire, 0));
  Edit(Rename(1, "gate"));
  RetentionPolicy policy;
  policy.keep_versions = 1;
  ASSERT_THAT(CompactStore(path_, policy, false), IsOk());
  EXPECT_THAT(Undo(retired.edit).version, ::testing::Ne(std::nullopt));
  EXPECT_NE(Group(*store_.LoadAt("floor"), NameOf(0)), nullptr);
  ExpectClean();
}

// Rolled back to a build that holds an edit which was taken back since. Once what the edit took
// away is compacted, the map stays as it is, and can be built on and edited.
TEST_F(EditTest, AnEditTakenBackStaysInABuildOnceWhatItTookAwayIsCompacted) {
  MapEdit merge = Make(EditKind::kMerge, 0);
  merge.mode = content_.groups[0].modes.back().number;
  merge.into = content_.groups[0].modes.front().number;
  ASSERT_NE(merge.mode, merge.into);
  MapEdit calibration;
  calibration.kind = EditKind::kCalibration;
  calibration.author = calibration.reason = "test";
  calibration.vehicle = content_.vehicles[0].vehicle;
  calibration.since = content_.vehicles[0].stamp;
  for (const MapEdit& edit : {Make(EditKind::kRetire, 0), merge, calibration}) {
    SCOPED_TRACE(::shiftmap::NameOf(edit.kind));
    const EditResult made = Edit(edit);
    const CommitResult built = Build();
    const std::string map = ContentHash(store_.LoadAt("floor")->content());
    Undo(made.edit);
    ASSERT_EQ(*store_.Rollback("floor"), built.version);
    RetentionPolicy policy;
    policy.keep_versions = 1;
    ASSERT_THAT(CompactStore(path_, policy, false), IsOk());
    const StatusOr<VersionNumber> prior = store_.WithEditsInForce("floor", built.version);
    ASSERT_THAT(prior, IsOk());
    EXPECT_EQ(*prior, built.version);
    EXPECT_EQ(ContentHash(store_.LoadAt("floor")->content()), map);
    const EditResult other = Edit(Rename(2, "gate"));
    Undo(other.edit);
    Build();
    ExpectClean();
    // For the next edit.
    CommitOptions options;
    options.replace = true;
    options.states_probabilities = false;
    ASSERT_THAT(store_.Commit("floor", content_, {"test", "", 0, {}}, options), IsOk());
  }
}

// A version that is kept can be edited after a rollback to it, so that the build which it is an
// edit of is kept too.
TEST_F(EditTest, CompactingKeepsTheBuildThatAKeptVersionIsAnEditOf) {
  const EditResult first = Edit(Rename(0, "gate"));
  Build();
  RetentionPolicy policy;
  policy.keep_versions = 2;
  ASSERT_THAT(CompactStore(path_, policy, false), IsOk());
  ASSERT_EQ(*store_.Rollback("floor"), first.version->version);
  Edit(Rename(1, "door"));
  Undo(first.edit);
  ExpectClean();
}

TEST_F(EditTest, AResetCalibrationIsWhatWasKnownBefore) {
  MapContent later = content_;
  later.vehicles[0].stamp = At(50.0);
  later.vehicles[0].runs += 1;
  later.vehicles[0].log_scale_v.value += 0.01;
  later.stamp = At(60.0);
  CommitOptions options;
  options.parent = first_.version;
  options.states_probabilities = false;
  ASSERT_THAT(store_.Commit("floor", later, {"test", "", 0, {}}, options), IsOk());
  MapEdit edit;
  edit.kind = EditKind::kCalibration;
  edit.author = "surveyor";
  edit.reason = "new tyres";
  edit.vehicle = content_.vehicles[0].vehicle;
  edit.since = content_.vehicles[0].stamp + Duration(1);
  const EditResult reset = Edit(edit);
  const auto value = [&] { return store_.LoadAt("floor")->vehicles()[0].log_scale_v.value; };
  EXPECT_EQ(value(), content_.vehicles[0].log_scale_v.value);
  RetentionPolicy policy;
  policy.keep_versions = 1;
  ASSERT_THAT(CompactStore(path_, policy, false), IsOk());
  ExpectClean();
  Undo(reset.edit);
  EXPECT_EQ(value(), later.vehicles[0].log_scale_v.value);
  edit.since = content_.vehicles[0].stamp;
  Edit(edit);
  EXPECT_THAT(store_.LoadAt("floor")->vehicles(), IsEmpty());
}

TEST_F(EditTest, VerifyFindsAnEditThatWasChanged) {
  Edit(Rename(0, "gate"));
  Change("UPDATE map_edit SET new_name = 'door'");
  ExpectDefect("its edits give another content");
}

// By another release, a little: its content is as the release that made it computed, by its hash.
TEST_F(EditTest, VerifyLetsAControlPointBeComputedOtherwise) {
  Edit(Control());
  Change("UPDATE map_edit SET x_m = x_m + 1e-9");
  ExpectClean();
  Change("UPDATE map_edit SET x_m = x_m + 1.0");
  ExpectDefect("its edits put mode 1 of ");
}

TEST_F(EditTest, VerifyFindsAnEditAfterAControlPointThatWasChanged) {
  Edit(Control());
  Edit(Make(EditKind::kRetire, 0));
  ExpectClean();
  Change("UPDATE map_edit SET signature = '" + NameOf(2) + "', landmark = '" + NameOf(2) +
         "' WHERE edit_id = 2");
  ExpectDefect("its edits give other landmarks or modes");
}

TEST_F(EditTest, DerivedNumbersOfAnEditedVersionAreRecomputedBitByBit) {
  for (int i = 0; i < 8; ++i) {
    ASSERT_THAT(store_.Return(Report(first_, NameOf(static_cast<std::size_t>(i % 3)), 100.0 * i)),
                IsOk());
  }
  Edit(Rename(0, "gate"));
  MapEdit rate = Make(EditKind::kRate, 1);
  rate.rate_per_s = 1e-3;
  rate.weight = 3.0;
  Edit(rate);
  const std::string before = ContentHash(store_.LoadAt("floor")->content());
  {
    StatusOr<Database> database = Database::Open(path_, {Database::Mode::kReadWrite});
    ASSERT_THAT(database->Execute("DELETE FROM ledger_checkpoint"), IsOk());
  }
  EXPECT_EQ(ContentHash(store_.LoadAt("floor")->content()), before);
  ExpectClean();
}

}  // namespace
}  // namespace shiftmap::testing
