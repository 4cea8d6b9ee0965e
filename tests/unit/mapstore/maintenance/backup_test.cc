// SPDX-License-Identifier: Apache-2.0
#include "mapstore/maintenance/backup.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <random>
#include <string>
#include <thread>

#include "mapstore/maintenance/verify.h"
#include "mapstore/map/sha256.h"
#include "mapstore/map_store.h"
#include "tests/support/random_map.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/mapstore/store/store_test_util.h"

namespace shiftmap::testing {
namespace {

class BackupTest : public ::testing::Test {
 protected:
  BackupTest() { Commit(); }

  // Another version; every one has other numbers.
  void Commit() {
    MapStore store = OpenStore(path_);
    MapContent content = RandomContent(random_);
    ASSERT_THAT(store.Commit("mine", content, {}, {}), IsOk());
  }

  static std::string HashOfMap(const std::string& path) {
    return (*MapStore::Open(path, MapStore::Access::kReadOnly)).LoadAt("mine")->content_hash();
  }

  std::mt19937_64 random_{TestSeed(41)};
  TempDir dir_;
  const std::string path_ = dir_.File("a.db");
  const std::string backup_ = dir_.File("backup.db");
};

TEST_F(BackupTest, ASnapshotIsNoBackup) {
  const std::string snapshot = dir_.File("f.snap");
  ASSERT_THAT(OpenStore(path_).ExportSnapshot("mine", snapshot), IsOk());
  const std::string before = *HashFile(path_);
  EXPECT_THAT(RestoreStore(snapshot, path_, true),
              StatusIs(StatusCode::kInvalidArgument, "is a snapshot, not a backup"));
  EXPECT_THAT(RestoreStore(snapshot, dir_.File("new.db"), false),
              StatusIs(StatusCode::kInvalidArgument, "is a snapshot, not a backup"));
  EXPECT_EQ(*HashFile(path_), before);
}

TEST_F(BackupTest, RestoresWhatWasThere) {
  const std::string content = HashOfMap(path_);
  const StatusOr<BackupResult> backup = BackupStore(path_, backup_);
  ASSERT_THAT(backup, IsOk());
  EXPECT_EQ(backup->sha256, *HashFile(backup_));
  Commit();
  EXPECT_NE(HashOfMap(path_), content);

  EXPECT_THAT(RestoreStore(backup_, path_, false),
              StatusIs(StatusCode::kFailedPrecondition, "exists already"));
  const std::string newer = HashOfMap(path_);
  const StatusOr<RestoreResult> restored = RestoreStore(backup_, path_, true);
  ASSERT_THAT(restored, IsOk());
  EXPECT_EQ(restored->restored.digest, backup->digest);
  EXPECT_EQ(HashOfMap(path_), content);
  // What was replaced is not lost.
  ASSERT_TRUE(restored->kept.has_value());
  EXPECT_EQ(HashOfMap(*restored->kept), newer);

  const StatusOr<RestoreResult> elsewhere = RestoreStore(backup_, dir_.File("b.db"), false);
  ASSERT_THAT(elsewhere, IsOk());
  EXPECT_EQ(elsewhere->restored.digest, backup->digest);
  EXPECT_FALSE(elsewhere->kept.has_value());
}

TEST_F(BackupTest, OpenStoresGoOnWithWhatWasRestored) {
  ASSERT_THAT(BackupStore(path_, backup_), IsOk());
  const std::string content = HashOfMap(path_);
  Commit();
  MapStore reader = *MapStore::Open(path_, MapStore::Access::kReadOnly);
  EXPECT_NE(reader.LoadAt("mine")->content_hash(), content);
  ASSERT_THAT(RestoreStore(backup_, path_, true), IsOk());
  EXPECT_EQ(reader.LoadAt("mine")->content_hash(), content);
}

TEST_F(BackupTest, WhileOthersWrite) {
  std::atomic<bool> stop = false;
  std::atomic<int> commits = 0;
  std::thread writer([&] {
    std::mt19937_64 random(5);
    MapStore store = OpenStore(path_);
    while (!stop) {
      const MapContent content = RandomContent(random);
      if (store.Commit("mine", content, {}, {}).ok()) ++commits;
      // Writers that leave no gap at all keep a reader out on a busy disk.
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
  });
  for (int i = 0; i < 5; ++i) {
    EXPECT_THAT(BackupStore(path_, backup_), IsOk());
    EXPECT_TRUE(VerifyStore(backup_)->clean());
  }
  stop = true;
  writer.join();
  EXPECT_GT(commits, 0);
}

TEST_F(BackupTest, DamagedBackupIsRefusedDamagedStoreIsReplaced) {
  ASSERT_THAT(BackupStore(path_, backup_), IsOk());
  const std::string content = HashOfMap(path_);
  std::filesystem::resize_file(path_, std::filesystem::file_size(path_) / 2);
  const StatusOr<RestoreResult> restored = RestoreStore(backup_, path_, true);
  ASSERT_THAT(restored, IsOk());
  EXPECT_EQ(HashOfMap(path_), content);
  EXPECT_TRUE(std::filesystem::exists(*restored->kept));

  std::filesystem::resize_file(backup_, std::filesystem::file_size(backup_) / 2);
  EXPECT_THAT(RestoreStore(backup_, path_, true), ::testing::Not(IsOk()));
  EXPECT_EQ(HashOfMap(path_), content);
}

// A journal that a crash left where no store is any more must not get into the restored one.
TEST_F(BackupTest, StaleJournalIsNotRolledBackIntoTheRestoredStore) {
  ASSERT_THAT(BackupStore(path_, backup_), IsOk());
  const std::string fresh = dir_.File("fresh.db");
  std::ofstream(fresh + "-journal") << std::string(8192, 'j');
  ASSERT_THAT(RestoreStore(backup_, fresh, false), IsOk());
  EXPECT_FALSE(std::filesystem::exists(fresh + "-journal"));
  EXPECT_TRUE(VerifyStore(fresh)->clean());
}

TEST_F(BackupTest, NotOntoItself) {
  EXPECT_THAT(BackupStore(path_, path_), StatusIs(StatusCode::kInvalidArgument, "itself"));
  EXPECT_THAT(RestoreStore(path_, path_, true), StatusIs(StatusCode::kInvalidArgument, "itself"));
  EXPECT_THAT(BackupStore(dir_.File("missing"), backup_), StatusIs(StatusCode::kNotFound, ""));
}

}  // namespace
}  // namespace shiftmap::testing
