// SPDX-License-Identifier: Apache-2.0
#include "mapstore/core/input_file.h"

#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstring>
#include <filesystem>
#include <vector>

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace shiftmap {
namespace {

using testing::IsOk;
using testing::StatusIs;

TEST(InputFile, ReadsARegularFileAlsoThroughALink) {
  const testing::TempDir dir;
  testing::WriteFile(dir.File("a"), "some\nbytes");
  std::filesystem::create_symlink(dir.File("a"), dir.File("link"));
  for (const char* name : {"a", "link"}) {
    const StatusOr<std::string> text = ReadInputFile("table", dir.File(name));
    ASSERT_THAT(text, IsOk());
    EXPECT_EQ(*text, "some\nbytes");
  }
  testing::WriteFile(dir.File("empty"), "");
  EXPECT_EQ(*ReadInputFile("table", dir.File("empty")), "");
}

TEST(InputFile, OnlyRegularFilesAreOpened) {
  const testing::TempDir dir;
  ASSERT_EQ(mkfifo(dir.File("fifo").c_str(), 0600), 0);
  const int fd = socket(AF_UNIX, SOCK_STREAM, 0);
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::strncpy(address.sun_path, dir.File("socket").c_str(), sizeof address.sun_path - 1);
  ASSERT_EQ(bind(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  std::filesystem::create_symlink("loop", dir.File("loop"));
  for (const std::string& path : {dir.File("fifo"),
                                  dir.File("socket"),
                                  std::string("/dev/zero"),
                                  std::string("/dev/null"),
                                  std::string("/proc/self/mem"),
                                  std::string("/proc"),
                                  dir.File("")}) {
    EXPECT_THAT(ReadInputFile("table", path),
                StatusIs(StatusCode::kInvalidArgument, "table '" + path + "': "));
  }
  EXPECT_THAT(ReadInputFile("table", dir.File("none")),
              StatusIs(StatusCode::kNotFound, "does not exist"));
  EXPECT_FALSE(ReadInputFile("table", dir.File("loop")).ok());
  close(fd);
}

TEST(InputFile, ALargeOneIsRefused) {
  const testing::TempDir dir;
  testing::WriteFile(dir.File("a"), std::string(200'001, 'x'));
  EXPECT_THAT(ReadInputFile("table", dir.File("a"), 200'001), IsOk());
  EXPECT_THAT(ReadInputFile("table", dir.File("a"), 200'000),
              StatusIs(StatusCode::kInvalidArgument, "above 200000 bytes"));
}

TEST(InputFile, LinesAreAsGetlineGivesThem) {
  std::string_view text = "one\n\nthree\r\nfour";
  std::vector<std::string_view> lines;
  for (std::string_view line; TakeLine(&text, &line);) lines.push_back(line);
  EXPECT_EQ(lines, (std::vector<std::string_view>{"one", "", "three\r", "four"}));
}

}  // namespace
}  // namespace shiftmap
