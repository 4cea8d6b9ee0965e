// SPDX-License-Identifier: Apache-2.0
#include "mapstore/core/lock_file.h"

#include <gtest/gtest.h>

#include <filesystem>

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace shiftmap {
namespace {

using testing::StatusIs;

TEST(LockFile, IsHeldByOneUntilItsEnd) {
  const testing::TempDir dir;
  const std::string path = dir.File("lock");
  {
    const auto first = LockFile(path);
    ASSERT_TRUE(first.ok());
    EXPECT_TRUE(*first);
    const auto second = LockFile(path);
    ASSERT_TRUE(second.ok());
    EXPECT_FALSE(*second);
  }
  EXPECT_TRUE(std::filesystem::exists(path));
  EXPECT_TRUE(*LockFile(path));
  EXPECT_THAT(LockFile(dir.File("none/lock")).status(),
              StatusIs(StatusCode::kNotFound, "none/lock': cannot be opened"));
  EXPECT_THAT(LockFile(dir.path()).status(),
              StatusIs(StatusCode::kUnavailable, "cannot be opened"));
}

}  // namespace
}  // namespace shiftmap
