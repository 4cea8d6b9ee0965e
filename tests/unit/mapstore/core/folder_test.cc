// SPDX-License-Identifier: Apache-2.0
#include "mapstore/core/folder.h"

#include <gtest/gtest.h>

#include <filesystem>

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

}  // namespace
}  // namespace shiftmap::testing
