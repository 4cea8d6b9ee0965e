// SPDX-License-Identifier: Apache-2.0
//
// Every kind of damage is put into a sound store with plain SQL, and must be found, and nothing
// else.
#include "mapstore/maintenance/verify.h"

#include <gtest/gtest.h>
#include <sqlite3.h>

#include <bit>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <random>
#include <set>
#include <string>
#include <vector>

#include "mapstore/maintenance/compact.h"
#include "mapstore/map_store.h"
#include "mapstore/sqlite/digest.h"
#include "mapstore/sqlite/row_checksum.h"
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
     "INSERT INTO ledger_summary VALUES (1, 1, 2, 1, 1, 0, 'L1', 3, 2, 0.5, 0)",
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
     "place among the reports"},
    {"MappedReport", "DELETE FROM version_run", "not about a run"},
    {"Visibility",
     "INSERT INTO mapped_visibility SELECT version_id, run_id, 'A', 1, x'00', 0 FROM version_run",
     "counts of scans are damaged"},
    {"VisibilityOfNoRun",
     "INSERT INTO mapped_visibility SELECT 1, run_id, 'A', 1, zeroblob(128), 0 FROM run",
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

// A value with one bit flipped; NULL and empty ones become others.
std::string Flipped(sqlite3_stmt* row, int bit) {
  switch (sqlite3_column_type(row, 0)) {
    case SQLITE_INTEGER:
      return std::to_string(sqlite3_column_int64(row, 0) ^ (std::int64_t{1} << bit));
    case SQLITE_FLOAT: {
      const auto bits = std::bit_cast<std::uint64_t>(sqlite3_column_double(row, 0));
      return fmt::format("{:.17e}", std::bit_cast<double>(bits ^ (std::uint64_t{1} << bit)));
    }
    case SQLITE_NULL:
      return "1";
    default: {
      const auto* bytes = static_cast<const char*>(sqlite3_column_blob(row, 0));
      std::string value(bytes, static_cast<std::size_t>(sqlite3_column_bytes(row, 0)));
      if (value.empty()) value = "?";
      value[value.size() / 2] = static_cast<char>(value[value.size() / 2] ^ 1);
      std::string hex;
      for (const char c : value) hex += fmt::format("{:02x}", static_cast<unsigned char>(c));
      const bool text = sqlite3_column_type(row, 0) == SQLITE_TEXT;
      return text ? "CAST(x'" + hex + "' AS TEXT)" : "x'" + hex + "'";
    }
  }
}

std::vector<std::vector<std::string>> Select(sqlite3* db, const std::string& sql) {
  std::vector<std::vector<std::string>> rows;
  sqlite3_stmt* query = nullptr;
  EXPECT_EQ(sqlite3_prepare_v2(db, sql.c_str(), -1, &query, nullptr), SQLITE_OK) << sql;
  while (sqlite3_step(query) == SQLITE_ROW) {
    rows.emplace_back();
    for (int i = 0; i < sqlite3_column_count(query); ++i) {
      rows.back().emplace_back(reinterpret_cast<const char*>(sqlite3_column_text(query, i)));
    }
  }
  sqlite3_finalize(query);
  return rows;
}

// A store with a row in every table; version 1 is compacted.
void MakeFullStore(const std::string& path) {
  MakeStore(path);
  MapStore::OpenOptions options;
  options.access = MapStore::Access::kReadWrite;
  options.checkpoint_rows = 1;
  MapStore store = *MapStore::Open(path, options);
  std::mt19937_64 random(TestSeed(33));
  RandomMapOptions map;
  map.groups = 4;
  map.rhythms = 1;
  map.vehicles = 1;
  map.anonymous_landmarks = 1;
  map.cross_block_share = 0.5;
  MapContent content = RandomContent(random, map);
  content.groups[0].merged = {{ModeNumber(77), content.groups[0].modes[0].number}};
  LandmarkGroup& group = content.groups[1];
  Eigen::MatrixXd rates = group.chain.rate_matrix();
  rates(0, 1) *= 2.0;
  rates(0, 0) = 0.0;
  rates(0, 0) = -rates.row(0).sum();
  group.chain = *ModeChain::FromRates(rates);
  content.stamp = At(2000.0);
  CommitOptions commit;
  commit.parent = VersionNumber(2);
  commit.states_probabilities = false;
  RunRecord run{"new", std::string(64, '7'), "truck", At(700.0), At(709.0), {{At(700.0), Se2()}}};
  run.evidence = {RandomEvidence(random, group, At(701.0), At(702.0))};
  run.visibility = {{group.signature, group.modes[0].number, {}}};
  const StatusOr<CommitResult> built =
      store.Commit("mine", content, {"test", "{}", 0, {run}}, commit);
  ASSERT_THAT(built, IsOk());
  ASSERT_THAT(store.Exclude("mine", {"", "loader", At(0.0), "test", {}}), IsOk());
  MapEdit split;
  split.kind = EditKind::kSplit;
  split.author = split.reason = "test";
  split.signature = content.groups[2].signature;
  split.mode = content.groups[2].modes[0].number;
  split.p_map_landmark = content.groups[2].modes[0].p_map_landmark;
  split.p_map_second = split.p_map_landmark + Eigen::Vector2d(5.0, 5.0);
  split.sd_m = 0.1;
  split.first_runs = {run.sha256};
  ASSERT_THAT(store.Edit("mine", split), IsOk());
  RetentionPolicy policy;
  policy.keep_versions = 4;
  ASSERT_THAT(CompactStore(path, policy, false), IsOk());
  StatusOr<Database> database = Database::Open(path, {Database::Mode::kReadWrite});
  ASSERT_THAT(
      database->Execute("INSERT INTO ledger_summary SELECT area_id, begin_ns, end_ns, report_id, "
                        "version_id, 0, signature, 3, 2, 0.5, 0 FROM visit_evidence LIMIT 1"),
      IsOk());
  ASSERT_THAT(SetChecksums(*database, "ledger_summary"), IsOk());
}

// Every column of every table: a bit that flips in a value is named with its table, and its row or,
// where the content hash of a version is of it, the version.
TEST(VerifyFileTest, FindsAFlippedBitInEveryColumn) {
  const TempDir dir;
  const std::string path = dir.File("a.db");
  const std::string damaged = dir.File("b.db");
  MakeFullStore(path);
  const StatusOr<VerifyResult> sound = VerifyStore(path);
  ASSERT_THAT(sound, IsOk());
  ASSERT_TRUE(sound->clean()) << sound->defects[0].table << sound->defects[0].row
                              << sound->defects[0].problem;
  const std::set<std::string> uncovered = {
      "area.rows_since_checkpoint",  // When to make the next checkpoint; what it is changes no map.
      "audit.audit_id",              // Rows are in its order in the file, which SQLite checks.
      "exclusion.exclusion_id",      // The same. Nothing refers to it.
  };
  // What refers to a row says so if its key changes.
  const std::set<std::string> referred = {"area.area_id",
                                          "version.version_id",
                                          "run.run_id",
                                          "shift_report.report_id",
                                          "map_edit.edit_id"};
  const std::set<std::string> hashed = {"landmark_group",
                                        "mode",
                                        "mode_covariance",
                                        "mode_rate",
                                        "mode_rhythm",
                                        "merged_mode",
                                        "anonymous_landmark"};
  sqlite3* db = nullptr;
  ASSERT_EQ(sqlite3_open(path.c_str(), &db), SQLITE_OK);
  const auto columns = Select(
      db,
      "SELECT m.name, c.name, (SELECT group_concat(name, ', ') FROM "
      "pragma_table_info(m.name) WHERE pk > 0) FROM sqlite_schema m, pragma_table_info(m.name) c "
      "WHERE m.type = 'table'");
  EXPECT_GT(columns.size(), 200U);
  int bit = 0;
  for (const std::vector<std::string>& column : columns) {
    const std::string& table = column[0];
    const std::string name = table + "." + column[1];
    if (uncovered.contains(name)) continue;
    SCOPED_TRACE(name);
    sqlite3_stmt* value = nullptr;
    ASSERT_EQ(
        sqlite3_prepare_v2(
            db,
            fmt::format("SELECT {}, {} FROM {} ORDER BY {}", column[1], column[2], table, column[2])
                .c_str(),
            -1,
            &value,
            nullptr),
        SQLITE_OK);
    ASSERT_EQ(sqlite3_step(value), SQLITE_ROW) << "no row";
    std::string key;
    std::string named;
    for (int i = 1; i < sqlite3_column_count(value); ++i) {
      const std::string text = reinterpret_cast<const char*>(sqlite3_column_text(value, i));
      const bool quoted = sqlite3_column_type(value, i) == SQLITE_TEXT;
      key += fmt::format("{}{}", i > 1 ? ", " : "", quoted ? "'" + text + "'" : text);
    }
    bit = 8 + (bit + 1) % 8;  // Not that of a key that is there.
    const std::string flipped = Flipped(value, bit);
    sqlite3_finalize(value);
    std::filesystem::copy_file(path, damaged, std::filesystem::copy_options::overwrite_existing);
    RunSql(damaged,
           fmt::format("PRAGMA synchronous=OFF; UPDATE {} SET {} = {} WHERE ({}) = ({})",
                       table,
                       column[1],
                       flipped,
                       column[2],
                       key));
    const StatusOr<VerifyResult> result = VerifyStore(damaged);
    ASSERT_THAT(result, IsOk());
    const std::string expected = hashed.contains(table) ? "version" : table;
    std::string all;
    bool found = false;
    for (const Defect& defect : result->defects) {
      all += defect.table + " | " + defect.row + " | " + defect.problem + "\n";
      found = found || referred.contains(name) || (defect.table == expected && !defect.row.empty());
    }
    EXPECT_TRUE(found) << flipped << " of " << key << ": " << all;
  }
  sqlite3_close(db);
}

// A bit that flips in the file: what rows hold is as it was, or verification tells.
TEST(VerifyFileTest, FindsFlippedBitsOfTheFile) {
  const TempDir dir;
  const std::string path = dir.File("a.db");
  const std::string damaged = dir.File("b.db");
  MakeFullStore(path);
  const auto digest = [](const std::string& file) {
    StatusOr<Database> database = Database::Open(file, {});
    return database.ok() ? DigestRows(*database) : StatusOr<std::string>(database.status());
  };
  const std::string whole = *digest(path);
  const std::string bytes = ReadFile(path);
  std::mt19937_64 random(TestSeed(34));
  int harmful = 0;
  for (int i = 0; i < 200; ++i) {
    std::string flipped = bytes;
    const std::size_t at = std::uniform_int_distribution<std::size_t>(0, bytes.size() - 1)(random);
    flipped[at] = static_cast<char>(flipped[at] ^ (1 << (i % 8)));
    WriteFile(damaged, flipped);
    const StatusOr<std::string> got = digest(damaged);
    if (got.ok() && *got == whole) continue;
    ++harmful;
    const StatusOr<VerifyResult> result = VerifyStore(damaged);
    EXPECT_TRUE(!result.ok() || !result->clean()) << "byte " << at << ", bit " << i % 8;
  }
  EXPECT_GT(harmful, 20);
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
