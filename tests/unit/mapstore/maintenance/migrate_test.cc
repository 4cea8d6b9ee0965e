// SPDX-License-Identifier: Apache-2.0
//
// Frozen stores of older schemas: they open with a clear refusal, and migrate without a loss.
#include "mapstore/maintenance/migrate.h"

#include <gtest/gtest.h>
#include <sqlite3.h>

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <vector>

#include "mapstore/maintenance/verify.h"
#include "mapstore/map/mode_filter.h"
#include "mapstore/map/sha256.h"
#include "mapstore/map_store.h"
#include "mapstore/schema/schema.h"
#include "mapstore/sqlite/database.h"
#include "tests/support/geometry_matchers.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace shiftmap::testing {
namespace {

using ::testing::ElementsAre;
using ::testing::SizeIs;

std::string Frozen(const std::string& name) {
  return std::string(SHIFTMAP_TEST_DATA) + "/stores/" + name;
}

nlohmann::json ReadJson(const std::string& path) {
  std::ifstream file(path);
  return nlohmann::json::parse(file);
}

// A frozen store: its schema, and how much its reports told.
struct OldStore {
  int schema;
  std::size_t reports;
  std::int64_t evidence_rows;
  std::size_t sightings;
};

class MigrateTest : public ::testing::TestWithParam<OldStore> {
 protected:
  MigrateTest() { std::filesystem::copy_file(Frozen(name_ + ".db"), path_); }

  const std::string name_ = "schema_" + std::to_string(GetParam().schema);

  TempDir dir_;
  const std::string path_ = dir_.File("a.db");
};

TEST_P(MigrateTest, OpeningOnlyChecks) {
  const std::string before = *HashFile(path_);
  for (const auto access : {MapStore::Access::kReadOnly,
                            MapStore::Access::kReadWrite,
                            MapStore::Access::kReadWriteCreate}) {
    EXPECT_THAT(MapStore::Open(path_, access),
                StatusIs(StatusCode::kFailedPrecondition,
                         "schema version " + std::to_string(GetParam().schema) +
                             ", this build reads 10; 'shiftmap-inspect migrate'"));
  }
  EXPECT_EQ(*HashFile(path_), before);
}

// What the build of that schema said of the store: every number as it was, but for what reports
// say, which that build believed without a doubt.
TEST_P(MigrateTest, KeepsContentAndProbabilities) {
  const std::string before = *HashFile(path_);
  const StatusOr<MigrateResult> result = MigrateStore(path_, "");
  ASSERT_THAT(result, IsOk());
  EXPECT_EQ(result->from, GetParam().schema);
  EXPECT_EQ(result->backup, path_ + ".schema" + std::to_string(GetParam().schema) + ".bak");
  EXPECT_FALSE(before.empty());

  MapStore store = *MapStore::Open(path_, MapStore::Access::kReadOnly);
  for (const int version : {1, 2}) {
    const nlohmann::json frozen =
        ReadJson(Frozen(name_ + "_floor_" + std::to_string(version) + ".json"));
    const StatusOr<MapSnapshot> map = version == 2
                                          ? store.LoadAt("floor", VersionNumber(version))
                                          : store.LoadVersion("floor", VersionNumber(version));
    ASSERT_THAT(map, IsOk());
    EXPECT_EQ(map->content_hash(), frozen["content_hash"]);
    EXPECT_EQ(ContentHash(store.LoadVersion("floor", VersionNumber(version))->content()),
              frozen["content_hash"]);
    EXPECT_EQ(map->vehicles().empty(), GetParam().schema < 3);
    ASSERT_EQ(map->groups().size(), frozen["groups"].size());
    for (std::size_t g = 0; g < map->groups().size(); ++g) {
      const LandmarkGroup& group = map->groups()[g];
      const nlohmann::json& modes = frozen["groups"][g]["modes"];
      for (const nlohmann::json& mode : modes) {
        const int state = group.StateOf(ModeNumber(mode["mode"].get<int>()));
        ASSERT_GE(state, 0);
        if (version == 2) {
          EXPECT_NEAR(group.probabilities(state),
                      mode["probability"].get<double>(),
                      10.0 * kMistakeProbability);
        }
        if (state == 0) continue;
        EXPECT_EQ(group.modes[static_cast<std::size_t>(state) - 1].p_map_landmark.x(),
                  mode["x_m"].get<double>());
      }
    }
  }
  const std::vector<ReportSummary> reports = *store.Reports("floor");
  std::int64_t evidence_rows = 0;
  for (const ReportSummary& report : reports) evidence_rows += report.evidence_rows;
  EXPECT_THAT(reports, SizeIs(GetParam().reports));
  EXPECT_EQ(evidence_rows, GetParam().evidence_rows);
  EXPECT_THAT(*store.Sightings("floor"), SizeIs(GetParam().sightings));
  EXPECT_EQ(store.AuditLog()->back().action, "migrate");
}

TEST_P(MigrateTest, HappensOnceAndOverwritesNoBackup) {
  const std::string backup = dir_.File("b.db");
  std::ofstream(backup) << "something";
  EXPECT_THAT(MigrateStore(path_, backup),
              StatusIs(StatusCode::kFailedPrecondition, "exists already"));
  EXPECT_THAT(MapStore::Open(path_, MapStore::Access::kReadOnly),
              StatusIs(StatusCode::kFailedPrecondition, "schema version "));
  std::filesystem::remove(backup);
  ASSERT_THAT(MigrateStore(path_, backup), IsOk());
  EXPECT_THAT(MigrateStore(path_, dir_.File("c.db")),
              StatusIs(StatusCode::kAlreadyExists, "schema 10 already"));
  // The backup is the old store, which migrates to the same.
  ASSERT_THAT(MigrateStore(backup, ""), IsOk());
  MapStore first = *MapStore::Open(path_, MapStore::Access::kReadOnly);
  MapStore second = *MapStore::Open(backup, MapStore::Access::kReadOnly);
  EXPECT_EQ(ContentHash(first.LoadAt("floor")->content()),
            ContentHash(second.LoadAt("floor")->content()));
}

// As on a full disk: what is left of a migration that fails does not keep the next one.
TEST_P(MigrateTest, AFailedOneLeavesTheStoreAndNoBackup) {
  const auto run = [&](const char* sql) {
    sqlite3* db = nullptr;
    ASSERT_EQ(sqlite3_open(path_.c_str(), &db), SQLITE_OK);
    EXPECT_EQ(sqlite3_exec(db, sql, nullptr, nullptr, nullptr), SQLITE_OK);
    sqlite3_close(db);
  };
  run("CREATE INDEX run_begin ON run (end_ns)");  // That of schema 10 cannot be made.
  EXPECT_THAT(MigrateStore(path_, dir_.File("b.db")).status(), ::testing::Not(IsOk()));
  EXPECT_FALSE(std::filesystem::exists(dir_.File("b.db")));
  run("DROP INDEX run_begin");
  ASSERT_THAT(MigrateStore(path_, dir_.File("b.db")), IsOk());
  EXPECT_TRUE(VerifyStore(path_)->clean());
}

TEST_P(MigrateTest, OneOfTwoAtATimeMigrates) {
  Status other;
  std::thread another([&] { other = MigrateStore(path_, dir_.File("b.db")).status(); });
  const Status one = MigrateStore(path_, dir_.File("b.db")).status();
  another.join();
  EXPECT_NE(one.ok(), other.ok());
  EXPECT_EQ((one.ok() ? other : one).code(), StatusCode::kAlreadyExists) << one << other;
  EXPECT_THAT(MigrateStore(dir_.File("b.db"), ""), IsOk());
}

TEST_P(MigrateTest, MigratedSchemaIsThatOfAFreshStore) {
  ASSERT_THAT(MigrateStore(path_, ""), IsOk());
  StatusOr<MapStore> store = MapStore::Open(path_, MapStore::Access::kReadWrite);
  ASSERT_THAT(store, IsOk());
  const MapContent content = store->LoadVersion("floor", VersionNumber(2))->content();
  CommitOptions options;
  options.parent = VersionNumber(2);
  EXPECT_EQ(store->Commit("floor", content, {}, options)->version, VersionNumber(3));
}

// A build that goes on from an old store has its probabilities, and adds its own visits to them.
TEST_P(MigrateTest, ADerivedVersionGoesOnFromWhatTheOldOneStated) {
  ASSERT_THAT(MigrateStore(path_, ""), IsOk());
  MapStore store = *MapStore::Open(path_, MapStore::Access::kReadWrite);
  const MapSnapshot old = *store.LoadAt("floor", VersionNumber(2));
  MapContent content = store.LoadVersion("floor", VersionNumber(2))->content();
  CommitOptions options;
  options.parent = VersionNumber(2);
  options.states_probabilities = false;
  ASSERT_THAT(store.Commit("floor", content, {}, options), IsOk());
  const MapSnapshot derived = *store.LoadAt("floor", std::nullopt, old.stamp());
  for (std::size_t g = 0; g < old.groups().size(); ++g) {
    EXPECT_THAT(derived.groups()[g].probabilities,
                IsNearMatrix(old.groups()[g].probabilities, 1e-12));
  }
  EXPECT_TRUE(VerifyStore(path_)->clean());
}

// Two builds that state nothing, a report about a run of each, and a run that is excluded.
TEST(MigrateDerivedTest, TheMemoryIsKept) {
  const TempDir dir;
  const std::string path = dir.File("a.db");
  std::filesystem::copy_file(Frozen("schema_4.db"), path);
  ASSERT_THAT(MigrateStore(path, ""), IsOk());
  EXPECT_TRUE(VerifyStore(path)->clean());
  MapStore store = *MapStore::Open(path, MapStore::Access::kReadOnly);
  const std::vector<VersionSummary> versions = *store.Versions("floor");
  ASSERT_THAT(versions, SizeIs(2));
  EXPECT_EQ(store.LoadAt("floor")->content_hash(), versions[1].content_hash);
  EXPECT_THAT(*store.Reports("floor"), SizeIs(2));
  EXPECT_THAT(*store.ExcludedRunsOf("floor", VersionNumber(2)), ElementsAre("run_001"));
  // 76 rows of mapped and 60 of reported visits; 24 are of run_001, and 26 reports of run_002.
  EXPECT_THAT(*store.Evidence("floor", VersionNumber(2)), SizeIs(76 - 24 + 34));
}

// Two builds, and reports about the run of the second one and about two of no build.
TEST(MigrateDerivedTest, TrustStartsAnew) {
  const TempDir dir;
  const std::string path = dir.File("a.db");
  std::filesystem::copy_file(Frozen("schema_5.db"), path);
  ASSERT_THAT(MigrateStore(path, ""), IsOk());
  EXPECT_TRUE(VerifyStore(path)->clean());
  MapStore store = *MapStore::Open(path, MapStore::Access::kReadOnly);
  ASSERT_THAT(*store.Versions("floor"), SizeIs(2));
  EXPECT_THAT(*store.Reports("floor"), SizeIs(3));
  // 24 rows of mapped visits, and 45 of reported ones, 16 of which are about a mapped run.
  EXPECT_THAT(*store.Evidence("floor", VersionNumber(2)), SizeIs(24 + 45 - 16));
}

// Two builds, the second published, a report, and two exclusions.
TEST(MigrateDerivedTest, WhatWasKnownIsThatOfTheMigration) {
  const TempDir dir;
  const std::string path = dir.File("a.db");
  std::filesystem::copy_file(Frozen("schema_6.db"), path);
  ASSERT_THAT(MigrateStore(path, ""), IsOk());
  EXPECT_TRUE(VerifyStore(path)->clean());
  MapStore store = *MapStore::Open(path, MapStore::Access::kReadOnly);
  const std::vector<Exclusion> exclusions = *store.Exclusions("floor");
  ASSERT_THAT(exclusions, SizeIs(2));
  EXPECT_FALSE(exclusions[0].held);
  EXPECT_EQ(exclusions[1].vehicle, "none");
  EXPECT_THAT(*store.ExcludedRunsOf("floor", VersionNumber(2)), ElementsAre("run_001"));
  const std::vector<AuditEntry> audit = *store.AuditLog("floor");
  const auto published = std::find_if(audit.begin(), audit.end(), [](const AuditEntry& entry) {
    return entry.action == "publish" && entry.subject == "1";
  });
  ASSERT_NE(published, audit.end());
  const Stamp excluded = exclusions[0].excluded;
  EXPECT_EQ(ContentHash(store.LoadKnown("floor", excluded)->content()),
            ContentHash(store.LoadAt("floor")->content()));
  EXPECT_NE(ContentHash(store.LoadKnown("floor", excluded - Duration(1))->content()),
            ContentHash(store.LoadAt("floor")->content()));
  EXPECT_EQ(store.LoadKnown("floor", published->written)->version(), VersionNumber(1));
  EXPECT_THAT(store.LoadKnown("floor", published->written - Duration(1)),
              StatusIs(StatusCode::kNotFound, "nothing was published by 20"));
}

// Two builds and a report: a store that nobody edited, and that can be.
TEST(MigrateDerivedTest, AnUneditedStoreTakesEdits) {
  const TempDir dir;
  const std::string path = dir.File("a.db");
  std::filesystem::copy_file(Frozen("schema_7.db"), path);
  ASSERT_THAT(MigrateStore(path, ""), IsOk());
  EXPECT_TRUE(VerifyStore(path)->clean());
  MapStore store = *MapStore::Open(path, MapStore::Access::kReadWrite);
  const MapSnapshot before = *store.LoadAt("floor");
  EXPECT_EQ(before.content_hash(),
            "c79a45435e4dbd3359ee9809e3c6fb51bfd91c97f51462a4b37a1098010e8c48");
  EXPECT_THAT(*store.Edits("floor"), SizeIs(0));
  MapEdit edit;
  edit.kind = EditKind::kRename;
  edit.author = edit.reason = "test";
  edit.signature = Signature("L1");
  edit.new_name = Signature("gate");
  const StatusOr<EditResult> result = store.Edit("floor", edit);
  ASSERT_THAT(result, IsOk());
  EXPECT_EQ(store.LoadAt("floor")->GroupIndex(Signature("L1")),
            store.LoadAt("floor")->GroupIndex(Signature("gate")));
  ASSERT_THAT(store.UndoEdit("floor", result->edit, {"test", "test", {}}), IsOk());
  EXPECT_EQ(ContentHash(store.LoadAt("floor")->content()), ContentHash(before.content()));
}

// A rename in force and a position that was taken back stay what they are, and a mode can be split.
TEST(MigrateDerivedTest, AnEditedStoreKeepsItsEdits) {
  const TempDir dir;
  const std::string path = dir.File("a.db");
  std::filesystem::copy_file(Frozen("schema_8_edited.db"), path);
  ASSERT_THAT(MigrateStore(path, ""), IsOk());
  EXPECT_TRUE(VerifyStore(path)->clean());
  MapStore store = *MapStore::Open(path, MapStore::Access::kReadWrite);
  EXPECT_EQ(store.LoadAt("floor")->content_hash(),
            "8caa77e988e41b33667e71c3d4b29ee3193659cdaa0993dad966bc519774c643");
  const std::vector<MapEdit> edits = *store.Edits("floor");
  ASSERT_THAT(edits, SizeIs(2));
  EXPECT_EQ(edits[0].new_name.text(), "gate");
  EXPECT_FALSE(edits[0].undone);
  EXPECT_EQ(edits[1].p_map_landmark, Eigen::Vector2d(3.0, 4.0));
  EXPECT_TRUE(edits[1].undone);
  MapEdit split;
  split.kind = EditKind::kSplit;
  split.author = split.reason = "test";
  split.signature = Signature("gate");
  split.mode = ModeNumber(1);
  split.p_map_second = {1.0, 1.0};
  split.sd_m = 0.1;
  EXPECT_THAT(store.Edit("floor", split), IsOk());
  EXPECT_TRUE(VerifyStore(path)->clean());
}

// Two builds and a report: chains without a rhythm, to which a build adds one.
TEST(MigrateDerivedTest, ChainsGetRhythms) {
  const TempDir dir;
  const std::string path = dir.File("a.db");
  std::filesystem::copy_file(Frozen("schema_8.db"), path);
  ASSERT_THAT(MigrateStore(path, ""), IsOk());
  EXPECT_TRUE(VerifyStore(path)->clean());
  MapStore store = *MapStore::Open(path, MapStore::Access::kReadWrite);
  const MapSnapshot before = *store.LoadAt("floor");
  EXPECT_EQ(before.content_hash(),
            "5ec5f391ca40a231460a7abe99245cc12a24e40254e26a6e0c811a5358303b7c");
  EXPECT_THAT(*store.Reports("floor"), SizeIs(1));
  MapContent content = store.LoadVersion("floor", before.version())->content();
  ModeChain& chain = content.groups[0].chain;
  EXPECT_EQ(chain.rhythm(), nullptr);
  const std::vector<Eigen::MatrixXd> hours(24, chain.rate_matrix());
  chain = *chain.WithRhythm(*ChainRhythm::Make(kRhythmDay, hours));
  CommitOptions options;
  options.parent = before.version();
  options.states_probabilities = false;
  ASSERT_THAT(store.Commit("floor", content, {}, options), IsOk());
  const MapSnapshot after = *store.LoadAt("floor", std::nullopt, before.stamp());
  ASSERT_NE(after.groups()[0].chain.rhythm(), nullptr);
  // The hours are alike.
  EXPECT_THAT(after.groups()[0].probabilities,
              IsNearMatrix(before.groups()[0].probabilities, 1e-9));
}

// Of two copies of a log the one against the older version counted, or both did, and a report about
// a copy of a mapped log.
TEST(MigrateDerivedTest, OfCopiesOfALogTheLongestCounts) {
  const TempDir dir;
  const std::string path = dir.File("a.db");
  std::filesystem::copy_file(Frozen("schema_9.db"), path);
  ASSERT_THAT(MigrateStore(path, ""), IsOk());
  const StatusOr<VerifyResult> verified = VerifyStore(path);
  ASSERT_THAT(verified, IsOk());
  EXPECT_TRUE(verified->clean()) << verified->defects[0].problem;
  MapStore store = *MapStore::Open(path, MapStore::Access::kReadOnly);
  std::vector<ReportSummary> reports = *store.Reports("floor");
  ASSERT_THAT(reports, SizeIs(5));
  std::sort(reports.begin(), reports.end(), [](const ReportSummary& a, const ReportSummary& b) {
    return a.uuid < b.uuid;
  });
  for (const std::size_t cut : {0, 2}) {
    ASSERT_THAT(reports[cut].set_aside, SizeIs(1));
    EXPECT_EQ(reports[cut].set_aside[0].reason, SetAside::kSameRun);
    EXPECT_THAT(reports[cut + 1].set_aside, SizeIs(0));
  }
  ASSERT_THAT(reports[4].set_aside, SizeIs(1));
  EXPECT_EQ(reports[4].set_aside[0].reason, SetAside::kRunInMap);
}

// A snapshot of an older build is read after its migration, and still is no store.
TEST(MigrateDerivedTest, AMigratedSnapshotStaysOne) {
  const TempDir dir;
  const std::string path = dir.File("a.db");
  std::filesystem::copy_file(Frozen("schema_8.db"), path);
  {
    StatusOr<Database> database = Database::Open(path, {Database::Mode::kReadWrite});
    ASSERT_THAT(database->Execute("DELETE FROM audit"), IsOk());
  }
  ASSERT_THAT(MigrateStore(path, ""), IsOk());
  EXPECT_THAT(MapStore::Open(path, MapStore::Access::kReadOnly)->LoadAt("floor"), IsOk());
  EXPECT_THAT(MapStore::Open(path, MapStore::Access::kReadWrite),
              StatusIs(StatusCode::kFailedPrecondition, "is a snapshot"));
}

// The rows that its checkpoint was made from are elsewhere.
TEST(MigrateDerivedTest, ASnapshotIsExportedAnew) {
  const TempDir dir;
  const std::string path = dir.File("a.db");
  std::filesystem::copy_file(Frozen("schema_5.db"), path);
  {
    StatusOr<Database> database = Database::Open(path, {Database::Mode::kReadWrite});
    ASSERT_THAT(database->Execute("INSERT INTO ledger_checkpoint (area_id, version_id, before_ns, "
                                  "newest_end_ns, rows_stored, states) "
                                  "SELECT area_id, version_id, 1, 1, 0, x'' FROM version LIMIT 1"),
                IsOk());
  }
  const std::string before = *HashFile(path);
  EXPECT_THAT(MigrateStore(path, ""),
              StatusIs(StatusCode::kFailedPrecondition, "is a snapshot: migrate its store"));
  EXPECT_EQ(*HashFile(path), before);
}

// A header whose version is not that of the tables.
TEST(MigrateDerivedTest, AVersionThatWasSetBackIsDamage) {
  for (std::int64_t version = 1; version < kSchemaVersion; ++version) {
    SCOPED_TRACE(version);
    const TempDir dir;
    const std::string path = dir.File("a.db");
    ASSERT_THAT(MapStore::Open(path, MapStore::Access::kReadWriteCreate), IsOk());
    {
      StatusOr<Database> database = Database::Open(path, {Database::Mode::kReadWrite});
      ASSERT_THAT(database->Execute("PRAGMA user_version = " + std::to_string(version)), IsOk());
    }
    const std::string before = *HashFile(path);
    EXPECT_THAT(MigrateStore(path, dir.File("b.db")),
                StatusIs(StatusCode::kDataLoss, "damaged: its tables are not those of schema"));
    EXPECT_EQ(*HashFile(path), before);
    EXPECT_FALSE(std::filesystem::exists(dir.File("b.db")));
  }
}

INSTANTIATE_TEST_SUITE_P(Schemas,
                         MigrateTest,
                         ::testing::Values(OldStore{1, 2, 28, 4},
                                           OldStore{2, 2, 20, 7},
                                           OldStore{3, 3, 60, 5}));

}  // namespace
}  // namespace shiftmap::testing
