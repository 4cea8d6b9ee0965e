// SPDX-License-Identifier: Apache-2.0
//
// Two stores live through the same random history, but in one of them a surveyor edits the map and
// takes everything back: no number tells them apart then.
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <map>
#include <optional>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "mapstore/maintenance/verify.h"
#include "mapstore/map_store.h"
#include "tests/support/random_map.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace shiftmap::testing {
namespace {

constexpr int kHistories = 4;
constexpr int kSteps = 50;

class EditHistory : public ::testing::TestWithParam<int> {
 protected:
  EditHistory() {
    for (const std::string& path : {edited_path_, plain_path_}) {
      MapStore::OpenOptions options;
      options.access = MapStore::Access::kReadWriteCreate;
      options.checkpoint_rows = 4;
      options.clock = [this] { return clock_; };
      stores_.push_back(*MapStore::Open(path, options));
    }
    MapContent content = RandomContent(random_, {.groups = 4, .vehicles = 2, .rhythms = 2});
    content.stamp = begin_;
    for (LandmarkGroup& group : content.groups) {
      group.chain = ModeChain::Uniform(static_cast<int>(group.modes.size()), 1e-5);
      landmarks_.push_back(group.signature);
    }
    CommitOptions options;
    options.states_probabilities = Chance(0.5);
    for (MapStore& store : stores_) {
      EXPECT_THAT(store.Commit("mine", content, {"test", "", 0, {}}, options), IsOk());
    }
  }

  MapStore& edited() { return stores_[0]; }
  MapStore& plain() { return stores_[1]; }

  int Below(int bound) { return std::uniform_int_distribution<int>(0, bound - 1)(random_); }
  bool Chance(double probability) { return std::bernoulli_distribution(probability)(random_); }

  std::vector<MapEdit> InForce() {
    std::vector<MapEdit> edits = *edited().Edits("mine");
    std::erase_if(edits, [](const MapEdit& edit) { return edit.undone.has_value(); });
    return edits;
  }

  const std::string& AnyReport() {
    return reports_[static_cast<std::size_t>(Below(static_cast<int>(reports_.size())))];
  }

  static const LandmarkGroup* Find(const MapSnapshot& map, const Signature& name) {
    const int index = map.GroupIndex(name);
    return index < 0 ? nullptr : &map.groups()[static_cast<std::size_t>(index)];
  }

  // A visit of what both stores know.
  void Return() {
    const MapSnapshot with = *edited().LoadAt("mine");
    const MapSnapshot without = *plain().LoadAt("mine");
    const Signature& landmark = landmarks_[static_cast<std::size_t>(Below(4))];
    const LandmarkGroup* const group = Find(with, landmark);
    const LandmarkGroup* const known = Find(without, landmark);
    if (group == nullptr) return;
    const Stamp begin = begin_ + std::chrono::seconds(Below(100'000));
    VisitEvidence visit =
        RandomEvidence(random_, *known, begin, begin + std::chrono::seconds(Below(3000)));
    std::erase_if(visit.modes, [&](const auto& mode) { return group->StateOf(mode.mode) < 0; });
    ShiftReport report;
    report.uuid = fmt::format("{:08x}-0000-4000-8000-{:012x}", Below(1 << 30), uuids_++);
    report.vehicle = Chance(0.7) ? "truck" : "loader";
    report.software = "test";
    report.area = "mine";
    report.begin = begin_;
    report.end = begin_ + std::chrono::hours(72);
    for (const auto& [store, map, of] :
         {std::tuple(&edited(), &with, group), std::tuple(&plain(), &without, known)}) {
      report.version = map->version();
      report.content_hash = map->content_hash();
      visit.signature = of->signature;
      report.evidence = {visit};
      ASSERT_THAT(store->Return(report), IsOk());
    }
    reports_.push_back(report.uuid);
  }

  // A night that sees every landmark once, where no edit but renames is in force.
  void Build() {
    for (const MapEdit& edit : InForce()) {
      if (edit.kind != EditKind::kRename) return;
    }
    const Stamp begin = begin_ + std::chrono::seconds(Below(100'000));
    const std::uint64_t seed = random_();
    const MapSnapshot without = *plain().LoadAt("mine");
    RunRecord run{"run", fmt::format("{:064x}", ++runs_), "truck", begin_, begin, {}, {}};
    run.end = begin + std::chrono::hours(1);
    for (MapStore* const store : {&edited(), &plain()}) {
      std::mt19937_64 random(seed);
      const VersionNumber parent = **store->PublishedVersion("mine");
      const MapSnapshot map = *store->LoadVersion("mine", parent);
      run.evidence.clear();
      for (const Signature& landmark : landmarks_) {
        // The modes that both have: a number that was taken back is none.
        const LandmarkGroup* const known = Find(without, landmark);
        VisitEvidence visit =
            RandomEvidence(random, *known, begin, begin + std::chrono::seconds(60));
        visit.signature = Find(map, landmark)->signature;
        run.evidence.push_back(visit);
      }
      CommitOptions options;
      options.parent = parent;
      options.states_probabilities = false;
      MapContent content = map.content();
      content.stamp = std::max(content.stamp, run.end);
      ASSERT_THAT(store->Commit("mine", content, {"test", "", 0, {run}}, options), IsOk());
    }
  }

  void Edit() {
    const MapSnapshot map = *edited().LoadAt("mine");
    MapEdit edit;
    edit.author = "surveyor";
    edit.reason = "test";
    edit.signature = landmarks_[static_cast<std::size_t>(Below(4))];
    edit.p_map_landmark = {0.1 * Below(1000), 0.1 * Below(1000)};
    edit.sd_m = 0.05;
    edit.mode = ModeNumber(1 + Below(3));
    edit.into = ModeNumber(1 + Below(3));
    edit.rate_per_s = 1e-4;
    edit.weight = 1.0 + Below(5);
    edit.p_map_second = {0.1 * Below(1000), -1.0};
    if (!reports_.empty() && Chance(0.5)) edit.first_runs = {AnyReport()};
    if (!reports_.empty() && Chance(0.5)) edit.second_runs = {AnyReport()};
    edit.kind = static_cast<EditKind>(Below(9));
    edit.new_name = Signature(fmt::format("n{}", ++names_));
    if (edit.kind == EditKind::kCalibration) {
      if (map.vehicles().empty()) return;
      edit.vehicle = map.vehicles()[0].vehicle;
      edit.since = map.vehicles()[0].stamp;
    }
    // Some of them cannot be done.
    const StatusOr<EditResult> result = edited().Edit("mine", edit);
    if (result.ok()) ++kinds_[edit.kind];
  }

  void Undo() {
    const std::vector<MapEdit> edits = InForce();
    if (edits.empty()) return;
    const MapEdit& edit = edits[static_cast<std::size_t>(Below(static_cast<int>(edits.size())))];
    const StatusOr<EditResult> result =
        edited().UndoEdit("mine", edit.id, {"surveyor", "test", {}});
    // Unless another one needs it.
    EXPECT_TRUE(result.ok() || result.status().code() == StatusCode::kFailedPrecondition)
        << Message(result.status());
  }

  void UndoAll() {
    for (int round = 0; round < 1000 && !InForce().empty(); ++round) Undo();
    ASSERT_TRUE(InForce().empty());
  }

  void Compare() {
    for (int i = 0; i < 3; ++i) {
      const Stamp at = begin_ + std::chrono::seconds(Below(120'000));
      const MapSnapshot with = *edited().LoadAt("mine", std::nullopt, at);
      const MapSnapshot without = *plain().LoadAt("mine", std::nullopt, at);
      ASSERT_EQ(with.groups().size(), without.groups().size());
      for (std::size_t g = 0; g < with.groups().size(); ++g) {
        const LandmarkGroup& group = with.groups()[g];
        ASSERT_EQ(group.signature, without.groups()[g].signature);
        EXPECT_EQ(group.probabilities, without.groups()[g].probabilities) << "group " << g;
        for (std::size_t k = 0; k < group.modes.size(); ++k) {
          EXPECT_EQ(group.modes[k].p_map_landmark, without.groups()[g].modes[k].p_map_landmark);
        }
        EXPECT_EQ(group.chain.rate_matrix(), without.groups()[g].chain.rate_matrix());
      }
      // Numbers of modes that were taken back are kept.
      if (kinds_[EditKind::kNewMode] == 0 && kinds_[EditKind::kSplit] == 0) {
        EXPECT_EQ(ContentHash(with.content()), ContentHash(without.content()));
      }
    }
  }

  std::mt19937_64 random_{TestSeed(static_cast<std::uint64_t>(GetParam()))};
  const Stamp begin_ = StampFromNanoseconds(1'700'000'000'000'000'000);
  Stamp clock_ = begin_ + std::chrono::hours(100);
  TempDir dir_;
  const std::string edited_path_ = dir_.File("edited.db");
  const std::string plain_path_ = dir_.File("plain.db");
  std::vector<MapStore> stores_;
  std::vector<Signature> landmarks_;
  std::vector<std::string> reports_;
  std::map<EditKind, int> kinds_;
  int uuids_ = 0;
  int runs_ = 0;
  int names_ = 0;
};

TEST_P(EditHistory, LeavesNoTraceWhenAllIsTakenBack) {
  for (int step = 0; step < kSteps && !HasFatalFailure(); ++step) {
    SCOPED_TRACE(step);
    clock_ += std::chrono::seconds(1);
    const int choice = Below(100);
    if (choice < 45) {
      Return();
    } else if (choice < 60) {
      Build();
    } else if (choice < 80) {
      Edit();
    } else if (choice < 95) {
      Undo();
    } else {
      UndoAll();
      Compare();
    }
  }
  UndoAll();
  Compare();
  const StatusOr<VerifyResult> verified = VerifyStore(edited_path_);
  ASSERT_THAT(verified, IsOk());
  EXPECT_TRUE(verified->clean()) << verified->defects[0].row << ": "
                                 << verified->defects[0].problem;
  EXPECT_GE(kinds_.size(), 3U);
}

INSTANTIATE_TEST_SUITE_P(Random, EditHistory, ::testing::Range(0, kHistories));

}  // namespace
}  // namespace shiftmap::testing
