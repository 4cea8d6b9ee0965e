// SPDX-License-Identifier: Apache-2.0
#include "localizer/live/unix_socket.h"

#include <gtest/gtest.h>

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace shiftmap::live {
namespace {

using testing::IsOk;
using testing::StatusIs;

TEST(UnixSocketTest, LiveOneIsRefusedStaleOneReplaced) {
  const testing::TempDir folder;
  const std::string path = folder.File("s");
  EXPECT_THAT(ConnectTo(path), StatusIs(StatusCode::kNotFound, path));
  {
    const auto first = ListenAt(path);
    ASSERT_THAT(first, IsOk());
    EXPECT_THAT(ConnectTo(path), IsOk());
    EXPECT_THAT(ListenAt(path), StatusIs(StatusCode::kUnavailable, "in use"));
    EXPECT_THAT(ConnectTo(path), IsOk());
  }
  EXPECT_THAT(ConnectTo(path), StatusIs(StatusCode::kNotFound, path));
  EXPECT_THAT(ListenAt(path), IsOk());
}

TEST(UnixSocketTest, NothingElseIsReplaced) {
  const testing::TempDir folder;
  testing::WriteFile(folder.File("notes"), "keep");
  EXPECT_THAT(ListenAt(folder.File("notes")),
              StatusIs(StatusCode::kInvalidArgument, "other than a socket"));
  EXPECT_EQ(testing::ReadFile(folder.File("notes")), "keep");
  EXPECT_THAT(ListenAt(folder.File("no/folder")), StatusIs(StatusCode::kNotFound, "bind"));
}

TEST(UnixSocketTest, PathMustFit) {
  const std::string path(108, 'x');
  EXPECT_THAT(ListenAt(path), StatusIs(StatusCode::kInvalidArgument, "108 bytes"));
  EXPECT_THAT(ConnectTo(path), StatusIs(StatusCode::kInvalidArgument, "108 bytes"));
  EXPECT_THAT(ListenAt(""), StatusIs(StatusCode::kInvalidArgument, "0 bytes"));
}

}  // namespace
}  // namespace shiftmap::live
