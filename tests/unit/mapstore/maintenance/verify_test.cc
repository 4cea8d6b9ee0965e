// SPDX-License-Identifier: Apache-2.0
//
// Every kind of damage is put into a sound store with plain SQL, and must be found, and nothing
// else.
#include "mapstore/maintenance/verify.h"

#include <gtest/gtest.h>
#include <sqlite3.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <random>
#include <string>

#include "mapstore/map_store.h"
#include "tests/support/random_map.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/mapstore/store/store_test_util.h"

namespace shiftmap::testing {
namespace {

// A store with three versions, mapped runs, reports, decisions, sightings and checkpoints.
void MakeStore(const std::string& path) {
  std::mt19937_64 random(TestSeed(31));
  MapStore::OpenOptions options;
  options.access = MapStore::Access::kReadWriteCreate;
  options.checkpoint_rows = 5;
  MapStore store = *MapStore::Open(path, options);
  MapContent content = RandomContent(random);
  content.groups[0].merged = {{ModeNumber(77), ModeNumber(1)}};
  content.stamp = At(0.0);
  Provenance provenance;
  provenance.runs = {{"run", std::string(64, 'a'), "truck", At(0.0), At(9.0), {{At(0.0), Se2()}}}};
  const CommitResult first = *store.Commit("mine", content, provenance, {});
  content.stamp = At(10.0);
  CommitOptions commit;
  commit.parent = first.version;
  const CommitResult second = *store.Commit("mine", content, provenance, commit);
  commit.parent = second.version;
  commit.publish = false;
  commit.states_probabilities = false;
  RunRecord mapped{"mapped", std::string(64, 'f'), "truck", At(2.0), At(9.0), {}};
  mapped.evidence = {RandomEvidence(random, content.groups[1], At(3.0), At(4.0))};
  ASSERT_THAT(store.Commit("mine", content, {"test", "", 0, {mapped}}, commit), IsOk());
  for (int i = 0; i < 6; ++i) {
    ShiftReport report = EmptyReport(second, "mine", i);
    report.run_hash = std::string(64, static_cast<char>('a' + i));
    for (const LandmarkGroup& group : content.groups) {
      const Stamp begin = At(100.0 * (i + 1));
      report.evidence.push_back(RandomEvidence(random, group, begin, begin));
    }
    report.decisions = {{content.groups[0].signature, ModeNumber(1), At(5.0), 20.0}};
    UnmappedSighting sighting;
    sighting.signature = Signature("?");
    sighting.cov_p_map_landmark = Eigen::Matrix2d::Identity();
    sighting.count = 3;
    sighting.first = sighting.last = At(5.0);
    report.sightings = {sighting};
    ASSERT_THAT(store.Return(report), IsOk());
  }
}

void RunSql(const std::string& path, const std::string& sql) {
  sqlite3* db = nullptr;
  ASSERT_EQ(sqlite3_open(path.c_str(), &db), SQLITE_OK);
  EXPECT_EQ(sqlite3_exec(db, sql.c_str(), nullptr, nullptr, nullptr), SQLITE_OK)
      << sqlite3_errmsg(db);
  sqlite3_close(db);
}

struct Damage {
  std::string name;
  std::string sql;
  std::string expected;  // Part of the text of a defect.
};

void PrintTo(const Damage& damage, std::ostream* out) { *out << damage.name; }

class VerifyTest : public ::testing::TestWithParam<Damage> {
 protected:
  TempDir dir_;
  const std::string path_ = dir_.File("a.db");
};

TEST_P(VerifyTest, FindsWhatIsWrong) {
  MakeStore(path_);
  StatusOr<VerifyResult> before = VerifyStore(path_);
  ASSERT_THAT(before, IsOk());
  ASSERT_TRUE(before->clean()) << before->defects[0].table << before->defects[0].problem;
  EXPECT_EQ(before->versions, 3);
  EXPECT_EQ(before->reports, 6);
  EXPECT_GT(before->evidence_rows, 60);
  EXPECT_GT(before->checkpoints, 0);
  RunSql(path_, GetParam().sql);
  const StatusOr<VerifyResult> after = VerifyStore(path_);
  ASSERT_THAT(after, IsOk());
  ASSERT_FALSE(after->clean());
  std::string all;
  for (const Defect& defect : after->defects) {
    all += defect.table + " | " + defect.row + " | " + defect.problem + "\n";
  }
  EXPECT_NE(all.find(GetParam().expected), std::string::npos) << all;
}

const Damage kDamages[] = {
    {"Position", "UPDATE mode SET x_m = x_m + 1e-9 WHERE version_id = 1", "content hash"},
    {"Probability",
     "UPDATE stated_probability SET probability = probability / 2 WHERE version_id = 2",
     "content hash"},
    {"StatementOfAnother",
     "UPDATE version SET statement_version_id = 1 WHERE number = 3",
     "statement"},
    {"MappedEvidence",
     "UPDATE mapped_evidence SET log_likelihoods = x'00'",
     "log-likelihoods are damaged"},
    {"SummaryOfNoRow",
     "INSERT INTO ledger_summary VALUES (1, 1, 2, 1, 1, 0, 'L1', 3, 2, 0.5)",
     "stands for no row"},
    {"MappedEvidenceOfNoRun",
     "DELETE FROM version_run WHERE version_id = 3",
     "its run is not of its version"},
    {"GroupGone",
     "PRAGMA foreign_keys=OFF; DELETE FROM landmark_group WHERE version_id = 1 AND group_index = 3",
     "refers to a row of landmark_group"},
    {"Published", "UPDATE version SET content_stored = 0 WHERE version_id = 2", "without content"},
    {"Parent", "UPDATE version SET parent_version_id = 2 WHERE version_id = 2", "its parent"},
    {"LedgerPosition", "UPDATE version SET ledger_position = 99 WHERE number = 2", "accounts for"},
    {"Trajectory", "UPDATE version_run SET trajectory = x'0102'", "trajectory is damaged"},
    {"Evidence",
     "UPDATE visit_evidence SET log_likelihoods = x'00' WHERE report_id = 3",
     "log-likelihoods are damaged"},
    {"EvidenceOfNoReport",
     "PRAGMA foreign_keys=OFF; DELETE FROM shift_report WHERE report_id = 4",
     "visit_evidence | "},
    {"EvidenceVersion", "UPDATE visit_evidence SET version_id = 1", "not that of its report"},
    {"FirstVisit",
     "UPDATE shift_report SET first_visit_ns = first_visit_ns + 1 WHERE report_id = 2",
     "before the first visit"},
    {"Superseded",
     "UPDATE shift_report SET identity = (SELECT identity FROM shift_report WHERE report_id = 1)",
     "more than one report"},
    {"MappedReport", "DELETE FROM version_run", "not about a run"},
    {"Visibility",
     "INSERT INTO mapped_visibility SELECT version_id, run_id, 'A', 1, x'00' FROM version_run",
     "counts of scans are damaged"},
    {"VisibilityOfNoRun",
     "INSERT INTO mapped_visibility SELECT 1, run_id, 'A', 1, zeroblob(128) FROM run",
     "its run is not of its version"},
    {"Sighting", "UPDATE sighting SET cov_xx_m2 = -1 WHERE report_id = 2", "covariance"},
    {"Checkpoint",
     "UPDATE ledger_checkpoint SET newest_end_ns = newest_end_ns + 1",
     "not what the ledger gives"},
    {"CheckpointBlob", "UPDATE ledger_checkpoint SET states = x'00'", "is damaged"},
    {"Table", "CREATE TABLE extra (x)", "a store does not have"},
    {"Index", "DROP INDEX version_parent", "is missing"},
    {"Trigger",
     "CREATE TRIGGER t AFTER INSERT ON audit BEGIN DELETE FROM mode; END",
     "trigger that a store does not have"},
};

INSTANTIATE_TEST_SUITE_P(Damages,
                         VerifyTest,
                         ::testing::ValuesIn(kDamages),
                         [](const auto& damage) { return damage.param.name; });

// It has rows of earlier versions, but neither their runs nor the reports that do not count.
TEST(VerifyFileTest, ASnapshotOfASoundStoreIsSound) {
  const TempDir dir;
  const std::string path = dir.File("a.db");
  MakeStore(path);
  MapStore store = *MapStore::Open(path, MapStore::Access::kReadWrite);
  ASSERT_THAT(store.Publish("mine", VersionNumber(3), VersionNumber(2)), IsOk());
  const MapContent content = store.LoadVersion("mine", VersionNumber(3))->content();
  std::mt19937_64 random(TestSeed(32));
  CommitOptions commit;
  commit.parent = VersionNumber(3);
  commit.publish = true;
  commit.states_probabilities = false;
  StatusOr<CommitResult> last = NotFound("nothing");
  for (const char* name : {"8", "9"}) {
    RunRecord run{name, std::string(64, *name), "truck", At(900.0), At(909.0), {}};
    run.evidence = {RandomEvidence(random, content.groups[1], At(901.0), At(902.0))};
    last = store.Commit("mine", content, {"test", "", 0, {run}}, commit);
    ASSERT_THAT(last, IsOk());
    commit.parent = last->version;
  }
  ShiftReport twice = EmptyReport(*last, "mine", 7);
  twice.run_hash = std::string(64, 'a');  // A report about this run counts already.
  ASSERT_THAT(store.Return(twice), IsOk());
  const std::string snapshot = dir.File("snapshot.db");
  ASSERT_THAT(store.ExportSnapshot("mine", snapshot), IsOk());
  for (const std::string& file : {path, snapshot}) {
    const StatusOr<VerifyResult> result = VerifyStore(file);
    ASSERT_THAT(result, IsOk());
    for (const Defect& defect : result->defects) {
      ADD_FAILURE() << file << ": " << defect.table << ' ' << defect.row << ": " << defect.problem;
    }
  }
}

TEST(VerifyFileTest, FindsADamagedPage) {
  const TempDir dir;
  const std::string path = dir.File("a.db");
  MakeStore(path);
  {
    std::fstream file(path, std::ios::in | std::ios::out | std::ios::binary);
    file.seekp(static_cast<std::streamoff>(std::filesystem::file_size(path) / 2));
    file << std::string(5000, '\xff');
  }
  const StatusOr<VerifyResult> result = VerifyStore(path);
  if (result.ok()) {
    EXPECT_FALSE(result->clean());
  } else {
    EXPECT_EQ(result.status().code(), StatusCode::kDataLoss);
  }
}

}  // namespace
}  // namespace shiftmap::testing
