// SPDX-License-Identifier: Apache-2.0
#include "localizer/transfer/partial_file.h"

#include <gtest/gtest.h>

#include <filesystem>

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace shiftmap::transfer {
namespace {

using ::shiftmap::testing::IsOk;
using ::shiftmap::testing::ReadFile;
using ::shiftmap::testing::StatusIs;
using ::shiftmap::testing::TempDir;
using ::shiftmap::testing::WriteFile;

class PartialFileTest : public ::testing::Test {
 protected:
  PartialFileTest() : path_(folder_.File("maps.db")) {
    snapshot_.area = "floor";
    snapshot_.version = VersionNumber(3);
    snapshot_.content_hash = "c0";
    snapshot_.ledger_sequence = LedgerPosition(17);
    snapshot_.sha256 = "ab";
    snapshot_.size_bytes = 10;
    snapshot_.signatures = {{"key", std::string("\0\xff signature", 12)}};
  }

  PartialFile Opened() {
    StatusOr<PartialFile> file = PartialFile::Open(path_);
    EXPECT_THAT(file, IsOk());
    return *std::move(file);
  }

  TempDir folder_;
  std::string path_;
  SnapshotInfo snapshot_;
};

TEST_F(PartialFileTest, AnotherProcessGoesOnWithWhatCame) {
  {
    PartialFile file = Opened();
    EXPECT_FALSE(file.of());
    ASSERT_THAT(file.Begin(snapshot_), IsOk());
    ASSERT_THAT(file.Append("01234"), IsOk());
  }
  PartialFile file = Opened();
  ASSERT_TRUE(file.of());
  EXPECT_EQ(file.size_bytes(), 5);
  EXPECT_EQ(file.of()->area, "floor");
  EXPECT_EQ(file.of()->version, VersionNumber(3));
  EXPECT_EQ(file.of()->content_hash, "c0");
  EXPECT_EQ(file.of()->ledger_sequence.value(), 17);
  EXPECT_EQ(file.of()->sha256, "ab");
  EXPECT_EQ(file.of()->size_bytes, 10);
  ASSERT_EQ(file.of()->signatures.size(), 1u);
  EXPECT_EQ(file.of()->signatures[0].signature, snapshot_.signatures[0].signature);
  ASSERT_THAT(file.Append("56789"), IsOk());
  EXPECT_FALSE(std::filesystem::exists(path_));
  ASSERT_THAT(file.Place(), IsOk());
  EXPECT_EQ(ReadFile(path_), "0123456789");
  EXPECT_FALSE(std::filesystem::exists(path_ + ".part"));
  EXPECT_FALSE(std::filesystem::exists(path_ + ".part.json"));
}

TEST_F(PartialFileTest, BytesWithoutAWholeDescriptionAreDropped) {
  for (const char* description : {"", "{", "[]", "{\"area\": 3}", "{\"area\": \"floor\"}"}) {
    WriteFile(path_ + ".part", "01234");
    WriteFile(path_ + ".part.json", description);
    const PartialFile file = Opened();
    EXPECT_FALSE(file.of()) << description;
    EXPECT_EQ(file.size_bytes(), 0) << description;
  }
}

TEST_F(PartialFileTest, MoreBytesThanTheSnapshotHasAreDropped) {
  {
    PartialFile file = Opened();
    ASSERT_THAT(file.Begin(snapshot_), IsOk());
  }
  WriteFile(path_ + ".part", "0123456789a");
  EXPECT_FALSE(Opened().of());
}

TEST_F(PartialFileTest, ASnapshotBegunAnewHasNoBytesOfTheOther) {
  PartialFile file = Opened();
  ASSERT_THAT(file.Begin(snapshot_), IsOk());
  ASSERT_THAT(file.Append("01234"), IsOk());
  snapshot_.sha256 = "cd";
  ASSERT_THAT(file.Begin(snapshot_), IsOk());
  EXPECT_EQ(file.size_bytes(), 0);
  EXPECT_EQ(ReadFile(file.part()), "");
}

TEST_F(PartialFileTest, OneProcessAtATimeFetches) {
  const PartialFile file = Opened();
  EXPECT_THAT(PartialFile::Open(path_), StatusIs(StatusCode::kUnavailable, "another process"));
}

TEST_F(PartialFileTest, SomethingElseInThePlaceStays) {
  std::filesystem::create_directory(path_);
  EXPECT_THAT(PartialFile::Open(path_), StatusIs(StatusCode::kInvalidArgument, path_));
  EXPECT_THAT(PartialFile::Open(folder_.File("no/maps.db")),
              StatusIs(StatusCode::kNotFound, "no/maps.db"));
  std::filesystem::remove(path_);
  std::filesystem::create_symlink(folder_.File("target"), path_ + ".part");
  EXPECT_FALSE(PartialFile::Open(path_).ok());
  EXPECT_FALSE(std::filesystem::exists(folder_.File("target")));
}

}  // namespace
}  // namespace shiftmap::transfer
