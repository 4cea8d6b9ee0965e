// SPDX-License-Identifier: Apache-2.0
//
// What Open and the first reads say about files that are not, or no longer, a good map store.
#include "mapstore/schema/store_file.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>

#include <csignal>
#include <filesystem>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "mapstore/maintenance/compact.h"
#include "mapstore/map/sha256.h"
#include "mapstore/map_store.h"
#include "mapstore/sqlite/transaction.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/mapstore/store/store_test_util.h"

namespace shiftmap::testing {
namespace {

using Access = MapStore::Access;

class StoreFileTest : public ::testing::Test {
 protected:
  TempDir dir_;
  std::string path_ = dir_.File("a.db");

  // A store with one area 'a' of one version.
  void MakeStore(int groups = 20) {
    std::mt19937_64 random(TestSeed(3));
    RandomMapOptions options;
    options.groups = groups;
    options.vehicles = 2;
    MapStore store = OpenStore(path_);
    ASSERT_THAT(store.Commit("a", RandomContent(random, options), {}, {}), IsOk());
  }

  void ExecuteRaw(const std::string& sql) {
    StatusOr<Database> database = Database::Open(path_, {Database::Mode::kReadWrite});
    ASSERT_THAT(database, IsOk());
    ASSERT_THAT(database->Execute(sql), IsOk());
  }
};

TEST_F(StoreFileTest, MissingFileIsNotFoundUnlessCreated) {
  EXPECT_THAT(MapStore::Open(path_, Access::kReadOnly),
              StatusIs(StatusCode::kNotFound, "map store '" + path_ + "': does not exist"));
  EXPECT_THAT(MapStore::Open(path_, Access::kReadWrite),
              StatusIs(StatusCode::kNotFound, "does not exist"));
  EXPECT_FALSE(std::filesystem::exists(path_));
  EXPECT_THAT(MapStore::Open(path_, Access::kReadWriteCreate), IsOk());
  EXPECT_THAT(MapStore::Open(path_, Access::kReadOnly), IsOk());
  EXPECT_THAT(MapStore::Open(dir_.File("no/a.db"), Access::kReadWriteCreate),
              StatusIs(StatusCode::kNotFound, "folder"));
}

// To SQLite these are databases of no file, gone once they are closed.
TEST_F(StoreFileTest, AStoreIsAlwaysAFile) {
  EXPECT_THAT(MapStore::Open("", Access::kReadWriteCreate),
              StatusIs(StatusCode::kInvalidArgument, "expected the path of a file"));
  const std::filesystem::path before = std::filesystem::current_path();
  std::filesystem::current_path(dir_.path());
  EXPECT_THAT(MapStore::Open(":memory:", Access::kReadWriteCreate), IsOk());
  EXPECT_THAT(MapStore::Open(":memory:", Access::kReadOnly), IsOk());
  std::filesystem::current_path(before);
  EXPECT_TRUE(std::filesystem::exists(dir_.File(":memory:")));
}

// A disk that is full, at any size of the file.
TEST_F(StoreFileTest, AStoreIsMadeAsAWholeOrNotAtAll) {
  const auto former = std::signal(SIGXFSZ, SIG_IGN);
  rlimit full{};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &full), 0);
  int failed = 0;
  for (rlim_t size = 0; !std::filesystem::exists(path_); size += 30'000) {
    ASSERT_LT(size, 1'000'000u);
    const rlimit limit{size, full.rlim_max};
    ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &limit), 0);
    const Status made = MapStore::Open(path_, Access::kReadWriteCreate).status();
    ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &full), 0);
    if (made.ok()) break;
    ++failed;
    EXPECT_THAT(made,
                StatusIs(StatusCode::kUnavailable, "map store '" + path_ + "': cannot be made: "));
    EXPECT_TRUE(std::filesystem::is_empty(dir_.path())) << size;
  }
  std::signal(SIGXFSZ, former);
  EXPECT_GT(failed, 2);
  EXPECT_THAT(MapStore::Open(path_, Access::kReadOnly), IsOk());
}

TEST_F(StoreFileTest, ManyMayMakeItAtOnce) {
  std::vector<Status> made(8);
  std::vector<std::thread> threads;
  for (Status& status : made) {
    threads.emplace_back(
        [&] { status = MapStore::Open(path_, Access::kReadWriteCreate).status(); });
  }
  for (std::thread& thread : threads) thread.join();
  for (const Status& status : made) EXPECT_THAT(status, IsOk());
  EXPECT_THAT(MapStore::Open(path_, Access::kReadOnly), IsOk());
}

// What a power cut in the middle of a write leaves: the file half changed, and its journal.
TEST_F(StoreFileTest, ReaderRollsBackWhatAPowerCutInterrupted) {
  MakeStore(200);
  MapStore before = *MapStore::Open(path_, Access::kReadOnly);
  const std::string hash = ContentHash(before.LoadAt("a")->content());
  const std::string image = dir_.File("image.db");
  {
    Database writer = *Database::Open(path_, {Database::Mode::kReadWrite});
    // A cache of one page, so that changes get to the file before the commit.
    ASSERT_THAT(writer.Execute("PRAGMA cache_size=1; BEGIN; UPDATE mode SET x_m = x_m + 1"),
                IsOk());
    std::filesystem::copy_file(path_, image);
    std::filesystem::copy_file(path_ + "-journal", image + "-journal");
    ASSERT_THAT(writer.Execute("ROLLBACK"), IsOk());
  }
  StatusOr<MapStore> after = MapStore::Open(image, Access::kReadOnly);
  ASSERT_THAT(after, IsOk());
  EXPECT_EQ(ContentHash(after->LoadAt("a")->content()), hash);
}

TEST_F(StoreFileTest, OtherFilesAreNotMapStores) {
  WriteFile(path_, std::string(5000, 'x') + "\nthis is a text file\n");
  for (const Access access : {Access::kReadOnly, Access::kReadWrite, Access::kReadWriteCreate}) {
    EXPECT_THAT(MapStore::Open(path_, access),
                StatusIs(StatusCode::kFailedPrecondition, "not a map store"));
  }
  EXPECT_THAT(MapStore::Open(dir_.path(), Access::kReadOnly),
              StatusIs(StatusCode::kFailedPrecondition, "not a map store"));
}

TEST_F(StoreFileTest, EmptyFileBecomesAStoreOnlyIfAsked) {
  WriteFile(path_, "");
  EXPECT_THAT(MapStore::Open(path_, Access::kReadOnly),
              StatusIs(StatusCode::kFailedPrecondition, "not a map store"));
  EXPECT_THAT(MapStore::Open(path_, Access::kReadWrite),
              StatusIs(StatusCode::kFailedPrecondition, "not a map store"));
  EXPECT_THAT(MapStore::Open(path_, Access::kReadWriteCreate), IsOk());
  EXPECT_THAT(MapStore::Open(path_, Access::kReadOnly), IsOk());
}

TEST_F(StoreFileTest, OtherDatabasesAreNotMapStores) {
  WriteFile(path_, "");
  ExecuteRaw("CREATE TABLE t (a)");
  for (const Access access : {Access::kReadOnly, Access::kReadWrite, Access::kReadWriteCreate}) {
    EXPECT_THAT(MapStore::Open(path_, access),
                StatusIs(StatusCode::kFailedPrecondition, "application id 0x00000000"));
  }
}

TEST_F(StoreFileTest, NewerSchemaIsNamed) {
  MakeStore();
  ExecuteRaw("PRAGMA user_version = 11");
  EXPECT_THAT(MapStore::Open(path_, Access::kReadOnly),
              StatusIs(StatusCode::kFailedPrecondition,
                       "map store '" + path_ +
                           "': schema version 11, this build reads 10; it needs a newer build"));
}

TEST_F(StoreFileTest, MissingTableIsDamage) {
  MakeStore();
  ExecuteRaw("PRAGMA foreign_keys=OFF; DROP TABLE mode");
  MapStore store = OpenStore(path_);
  EXPECT_THAT(store.LoadAt("a"), StatusIs(StatusCode::kDataLoss, "no such table"));
}

TEST_F(StoreFileTest, TruncatedStoreIsDamage) {
  MakeStore(500);
  const std::string bytes = ReadFile(path_);
  for (const double share : {0.9, 0.5, 0.1}) {
    WriteFile(path_, bytes.substr(0, static_cast<std::size_t>(share * double(bytes.size()))));
    StatusOr<MapStore> store = MapStore::Open(path_, Access::kReadOnly);
    const Status status = store.ok() ? store->LoadAt("a").status() : store.status();
    EXPECT_THAT(status, StatusIs(StatusCode::kDataLoss, "damaged"));
  }
}

TEST_F(StoreFileTest, AnyFlippedNumberIsDamage) {
  MakeStore();
  for (const char* sql : {"UPDATE mode SET x_m = x_m + 1e-9 WHERE group_index = 3",
                          "UPDATE version SET sensor_max_range_m = 11",
                          "DELETE FROM anonymous_landmark WHERE landmark_index = 1",
                          "UPDATE landmark_group SET leave_rate_per_s = -1",
                          "UPDATE vehicle_calibration SET lag_s = lag_s + 1e-9 WHERE runs > 0",
                          "DELETE FROM vehicle_calibration WHERE vehicle = 'truck-1'",
                          "UPDATE mode_covariance SET row_index = 1000000, column_index = 1000001 "
                          "WHERE row_index = (SELECT min(row_index) FROM mode_covariance)"}) {
    SCOPED_TRACE(sql);
    const std::string bytes = ReadFile(path_);
    ExecuteRaw(sql);
    MapStore store = OpenStore(path_);
    EXPECT_THAT(store.LoadVersion("a", VersionNumber(1)),
                StatusIs(StatusCode::kDataLoss, "area 'a': version 1"));
    WriteFile(path_, bytes);
  }
}

TEST_F(StoreFileTest, DamagedEvidenceIsDamage) {
  MapStore store = OpenStore(path_);
  const CommitResult version = *store.Commit("a", TwoStateContent(1e-3, 0.5, At(0.0)), {}, {});
  ShiftReport report = EmptyReport(version, "a", 1);
  report.evidence = {TwoStateEvidence(At(1.0), At(2.0), 0.0, 1.0)};
  ASSERT_THAT(store.Return(report), IsOk());
  ExecuteRaw("UPDATE visit_evidence SET log_likelihoods = x'00'");
  EXPECT_THAT(store.LoadAt("a"), StatusIs(StatusCode::kDataLoss, "evidence of 'A'"));
}

// A visit that began in time, with an end that no clock shows.
TEST_F(StoreFileTest, EvidenceWithoutAnEndIsDamage) {
  MapStore store = OpenStore(path_);
  const CommitResult version = *store.Commit("a", TwoStateContent(1e-3, 0.5, At(0.0)), {}, {});
  ShiftReport report = EmptyReport(version, "a", 1);
  report.evidence = {TwoStateEvidence(At(1.0), At(2.0), 0.0, 1.0)};
  ASSERT_THAT(store.Return(report), IsOk());
  ExecuteRaw("UPDATE visit_evidence SET end_ns = 7594885774896885871");
  ExecuteRaw("DELETE FROM ledger_checkpoint");
  EXPECT_THAT(store.LoadAt("a"), StatusIs(StatusCode::kDataLoss, "end of its evidence"));
}

TEST_F(StoreFileTest, ReadOnlyFolderAndFileAreReadButNotWritten) {
  MakeStore();
  ASSERT_EQ(chmod(path_.c_str(), 0444), 0);
  ASSERT_EQ(chmod(dir_.path().c_str(), 0555), 0);
  {
    const WithoutPrivilege unprivileged;
    StatusOr<MapStore> store = MapStore::Open(path_, Access::kReadOnly);
    ASSERT_THAT(store, IsOk());
    EXPECT_THAT(store->LoadAt("a"), IsOk());
    EXPECT_THAT(store->Commit("a", MapContent{}, {}, {}),
                StatusIs(StatusCode::kFailedPrecondition, "read-only"));
    EXPECT_THAT(MapStore::Open(path_, Access::kReadWrite),
                StatusIs(StatusCode::kUnavailable, "cannot be written"));
  }
  ASSERT_EQ(chmod(dir_.path().c_str(), 0755), 0);
}

TEST_F(StoreFileTest, AFileThatMayNotBeReadSaysSo) {
  MakeStore();
  ASSERT_EQ(chmod(path_.c_str(), 0), 0);
  const WithoutPrivilege unprivileged;
  EXPECT_THAT(MapStore::Open(path_, Access::kReadOnly),
              StatusIs(StatusCode::kUnavailable, "cannot be read: Permission denied"));
}

TEST_F(StoreFileTest, WhetherAStoreCanBeWrittenIsKnownBefore) {
  const std::string missing = dir_.File("missing.db");
  EXPECT_THAT(MapStore::CheckWritable(missing), IsOk());
  EXPECT_FALSE(std::filesystem::exists(missing));
  EXPECT_THAT(MapStore::CheckWritable(dir_.File("no/folder.db")),
              StatusIs(StatusCode::kNotFound, "folder does not exist"));
  EXPECT_THAT(MapStore::CheckWritable(dir_.path()),
              StatusIs(StatusCode::kFailedPrecondition, "not a regular file"));
  MakeStore();
  EXPECT_THAT(MapStore::CheckWritable(path_), IsOk());
  for (const auto& [file, folder] : {std::pair(0444, 0777), std::pair(0666, 0555)}) {
    ASSERT_EQ(chmod(path_.c_str(), static_cast<mode_t>(file)), 0);
    ASSERT_EQ(chmod(dir_.path().c_str(), static_cast<mode_t>(folder)), 0);
    const WithoutPrivilege unprivileged;
    EXPECT_THAT(MapStore::CheckWritable(path_),
                StatusIs(StatusCode::kUnavailable, "cannot be written"));
  }
  ASSERT_EQ(chmod(dir_.path().c_str(), 0755), 0);
}

// What a vehicle carries is not the site's store, whoever takes it for that.
TEST_F(StoreFileTest, ASnapshotIsNeverWrittenTo) {
  MakeStore();
  const std::string snapshot = dir_.File("f.snap");
  {
    MapStore store = *MapStore::Open(path_, Access::kReadWrite);
    // Nothing is published yet.
    EXPECT_THAT(MapStore::CheckWritable(path_), IsOk());
    ASSERT_THAT(store.Commit("floor", TwoStateContent(1e-3, 0.7, At(0.0)), {}, {}), IsOk());
    ASSERT_THAT(store.ExportSnapshot("floor", snapshot), IsOk());
  }
  const std::string before = *HashFile(snapshot);
  const auto refused = StatusIs(StatusCode::kFailedPrecondition, "is a snapshot");
  EXPECT_THAT(MapStore::CheckWritable(snapshot), refused);
  EXPECT_THAT(MapStore::CheckWritable(snapshot, /*dry_run=*/true), refused);
  EXPECT_THAT(MapStore::CheckWritable(dir_.File("no/folder.db"), /*dry_run=*/true), IsOk());
  for (const Access access : {Access::kReadWrite, Access::kReadWriteCreate}) {
    EXPECT_THAT(MapStore::Open(snapshot, access), refused);
  }
  EXPECT_THAT(CompactStore(snapshot, {}, false), refused);
  MapStore reader = *MapStore::Open(snapshot, Access::kReadOnly);
  EXPECT_THAT(reader.LoadAt("floor"), IsOk());
  EXPECT_THAT(reader.Rollback("floor", std::nullopt, true), refused);
  EXPECT_EQ(*HashFile(snapshot), before);
  EXPECT_THAT(MapStore::Open(path_, Access::kReadWrite), IsOk());
}

TEST_F(StoreFileTest, ALinkToAStoreMayStandWhereNothingCanBeWritten) {
  MakeStore();
  ASSERT_EQ(chmod(path_.c_str(), 0666), 0);
  ASSERT_EQ(chmod(dir_.path().c_str(), 0777), 0);
  const TempDir links;
  std::filesystem::create_symlink(path_, links.File("link.db"));
  ASSERT_EQ(chmod(links.path().c_str(), 0555), 0);
  {
    const WithoutPrivilege unprivileged;
    EXPECT_THAT(MapStore::CheckWritable(links.File("link.db")), IsOk());
    EXPECT_THAT(MapStore::Open(links.File("link.db"), Access::kReadWrite), IsOk());
  }
  ASSERT_EQ(chmod(links.path().c_str(), 0755), 0);
}

TEST_F(StoreFileTest, ReadingLeavesTheFileAsItIs) {
  MakeStore();
  const std::string before = ReadFile(path_);
  {
    StatusOr<MapStore> store = MapStore::Open(path_, Access::kReadOnly);
    ASSERT_THAT(store->LoadAt("a"), IsOk());
    ASSERT_THAT(store->ExportSnapshot("a", dir_.File("s.db")), IsOk());
  }
  EXPECT_EQ(ReadFile(path_), before);
}

TEST_F(StoreFileTest, LockedStoreIsUnavailable) {
  MakeStore();
  Database::Options options{Database::Mode::kReadWrite, std::chrono::milliseconds(20)};
  StatusOr<Database> holder = OpenStoreFile(path_, options);
  StatusOr<Database> other = OpenStoreFile(path_, options);
  ASSERT_THAT(holder, IsOk());
  ASSERT_THAT(other, IsOk());
  {
    StatusOr<Transaction> write = Transaction::Begin(*holder, Transaction::Kind::kWrite);
    ASSERT_THAT(write, IsOk());
    EXPECT_THAT(Transaction::Begin(*other, Transaction::Kind::kWrite),
                StatusIs(StatusCode::kUnavailable, "locked by another process"));
    // Readers are not kept out before the writer commits.
    EXPECT_THAT(other->QueryInt64("SELECT count(*) FROM area"), IsOk());
  }
  EXPECT_THAT(Transaction::Begin(*other, Transaction::Kind::kWrite), IsOk());
}

TEST_F(StoreFileTest, WritersOfSeveralThreadsWaitForEachOther) {
  constexpr int kWriters = 4;
  constexpr int kCommits = 5;
  std::vector<std::thread> writers;
  for (int i = 0; i < kWriters; ++i) {
    writers.emplace_back([this] {
      MapStore store = OpenStore(path_);
      for (int j = 0; j < kCommits; ++j) {
        EXPECT_THAT(store.Commit("a", TwoStateContent(1e-3, 0.5, At(j)), {}, {}), IsOk());
      }
    });
  }
  for (std::thread& writer : writers) writer.join();
  MapStore store = OpenStore(path_);
  EXPECT_EQ(store.Versions("a")->size(), std::size_t{kWriters * kCommits});
  EXPECT_EQ(*store.PublishedVersion("a"), VersionNumber(kWriters * kCommits));
}

}  // namespace
}  // namespace shiftmap::testing
