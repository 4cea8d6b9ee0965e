// SPDX-License-Identifier: Apache-2.0
#include "mapstore/sqlite/temporary_database.h"

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <functional>

#include "mapstore/maintenance/backup.h"
#include "mapstore/map_store.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/mapstore/store/store_test_util.h"

namespace shiftmap::testing {
namespace {

class TemporaryDatabaseTest : public ::testing::Test {
 protected:
  TemporaryDatabaseTest() {
    std::mt19937_64 random(TestSeed(3));
    MapStore store = OpenStore(store_);
    EXPECT_THAT(store.Commit("a", RandomContent(random, {}), {}, {}), IsOk());
  }

  std::ptrdiff_t FilesInFolder() const {
    return std::distance(std::filesystem::directory_iterator(dir_.path()), {});
  }

  // Another process makes a database for `destination` and is killed while SQLite writes it.
  void LeaveHalf(const std::string& destination) const {
    const pid_t child = fork();
    if (child == 0) {
      const StatusOr<TemporaryDatabase> temporary = TemporaryDatabase::Create(destination);
      if (!temporary.ok()) _exit(1);
      std::ofstream(temporary->path()) << "half a database";
      std::ofstream(temporary->path() + "-journal") << "its journal";
      _exit(0);
    }
    int status = 0;
    ASSERT_EQ(waitpid(child, &status, 0), child);
    ASSERT_EQ(status, 0);
  }

  TempDir dir_;
  std::string store_ = dir_.File("a.db");
};

TEST_F(TemporaryDatabaseTest, IsGoneWithItsJournal) {
  {
    const StatusOr<TemporaryDatabase> temporary = TemporaryDatabase::Create(dir_.File("b.db"));
    ASSERT_THAT(temporary, IsOk());
    std::ofstream(temporary->path()) << "rows";
    std::ofstream(temporary->path() + "-journal") << "journal";
  }
  EXPECT_EQ(FilesInFolder(), 1);
}

TEST_F(TemporaryDatabaseTest, OneThatIsAliveKeepsItsName) {
  const StatusOr<TemporaryDatabase> first = TemporaryDatabase::Create(dir_.File("b.db"));
  const StatusOr<TemporaryDatabase> second = TemporaryDatabase::Create(dir_.File("b.db"));
  ASSERT_THAT(first, IsOk());
  ASSERT_THAT(second, IsOk());
  EXPECT_NE(first->path(), second->path());
}

// The next command to the same destination removes what a killed one left.
TEST_F(TemporaryDatabaseTest, NothingOfAKilledCommandStays) {
  const std::string other = dir_.File("b.db");
  const std::string first = dir_.File("first.db");
  const std::vector<std::pair<std::string, std::function<Status()>>> commands = {
      {other, [&] { return OpenStore(store_).ExportSnapshot("a", other).status(); }},
      {other, [&] { return BackupStore(store_, other).status(); }},
      {store_, [&] { return RestoreStore(other, store_, false).status(); }},
      {first, [&] { return MapStore::Open(first, MapStore::Access::kReadWriteCreate).status(); }},
  };
  for (std::size_t i = 0; i < commands.size(); ++i) {
    SCOPED_TRACE(i);
    const auto& [destination, command] = commands[i];
    std::filesystem::remove(destination);
    const std::ptrdiff_t before = FilesInFolder();
    LeaveHalf(destination);
    ASSERT_GT(FilesInFolder(), before + 1);
    ASSERT_THAT(command(), IsOk());
    EXPECT_EQ(FilesInFolder(), before + 1);
  }
}

}  // namespace
}  // namespace shiftmap::testing
