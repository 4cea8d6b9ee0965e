// SPDX-License-Identifier: Apache-2.0
#include "mapstore/core/folder.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <filesystem>
#include <thread>
#include <vector>

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace shiftmap::testing {
namespace {

TEST(MakeFolderTest, MakesWhatIsMissing) {
  const TempDir dir;
  EXPECT_THAT(CheckFolder(dir.File("a/b")), IsOk());
  EXPECT_FALSE(std::filesystem::exists(dir.File("a")));
  for (int time = 0; time < 2; ++time) {
    EXPECT_THAT(MakeFolder(dir.File("a/b")), IsOk());
    EXPECT_TRUE(std::filesystem::is_directory(dir.File("a/b")));
  }
}

// Waiting does not help: something else is there.
TEST(MakeFolderTest, AFileInTheWayIsBadInput) {
  const TempDir dir;
  WriteFile(dir.File("file"), "kept");
  for (const char* path : {"file", "file/below"}) {
    EXPECT_THAT(MakeFolder(dir.File(path)),
                StatusIs(StatusCode::kInvalidArgument, "folder '" + dir.File(path) + "'"));
    EXPECT_THAT(CheckFolder(dir.File(path)),
                StatusIs(StatusCode::kInvalidArgument, "folder '" + dir.File(path) + "'"));
  }
  EXPECT_EQ(ReadFile(dir.File("file")), "kept");
}

TEST(MakeFolderTest, AFolderThatCannotBeWrittenToMayBecomeWritable) {
  const TempDir dir;
  std::filesystem::permissions(dir.path(), std::filesystem::perms::owner_read);
  {
    const WithoutPrivilege unprivileged;
    EXPECT_THAT(MakeFolder(dir.File("a")), StatusIs(StatusCode::kUnavailable, "folder '"));
    EXPECT_THAT(CheckFolder(dir.File("a")), StatusIs(StatusCode::kUnavailable, "folder '"));
    EXPECT_THAT(MakeFolder(dir.path()), StatusIs(StatusCode::kUnavailable, "cannot be written"));
    EXPECT_THAT(CheckFolder(dir.path()), StatusIs(StatusCode::kUnavailable, "cannot be written"));
  }
  std::filesystem::permissions(dir.path(), std::filesystem::perms::owner_all);
}

TEST(FolderLock, KeepsOthersWaiting) {
  const TempDir folder;
  std::atomic<int> inside = 0;
  std::atomic<int> most = 0;
  std::vector<std::thread> threads;
  for (int i = 0; i < 4; ++i) {
    threads.emplace_back([&] {
      for (int k = 0; k < 50; ++k) {
        const StatusOr<FolderLock> lock = FolderLock::Take(folder.path());
        ASSERT_TRUE(lock.ok()) << Message(lock.status());
        most = std::max(most.load(), ++inside);
        std::this_thread::yield();
        --inside;
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(most, 1);
}

TEST(FolderLock, NeedsAFolder) {
  const TempDir folder;
  EXPECT_THAT(FolderLock::Take(folder.File("no")), StatusIs(StatusCode::kNotFound, "folder '"));
  WriteFile(folder.File("file"), "");
  EXPECT_THAT(FolderLock::Take(folder.File("file")), StatusIs(StatusCode::kUnavailable, "locked"));
}

TEST(ScratchFolderTest, GoesWithAllThatIsInIt) {
  const TempDir dir;
  std::string path;
  {
    StatusOr<ScratchFolder> made = ScratchFolder::Make(dir.path());
    ASSERT_THAT(made, IsOk());
    const ScratchFolder scratch = *std::move(made);
    path = scratch.path();
    EXPECT_TRUE(path.starts_with(dir.path()));
    ASSERT_THAT(MakeFolder(path + "/a/b"), IsOk());
  }
  EXPECT_FALSE(std::filesystem::exists(path));
  EXPECT_THAT(ScratchFolder::Make(dir.File("none")),
              StatusIs(StatusCode::kUnavailable, "cannot be made"));
}

}  // namespace
}  // namespace shiftmap::testing
