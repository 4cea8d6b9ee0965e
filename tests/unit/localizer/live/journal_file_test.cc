// SPDX-License-Identifier: Apache-2.0
#include "localizer/live/journal_file.h"

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <csignal>
#include <vector>

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace shiftmap::live {
namespace {

using testing::IsOk;
using testing::ReadFile;
using testing::StatusIs;
using testing::TempDir;
using testing::WriteFile;

constexpr std::size_t kMagicBytes = 8;
constexpr std::size_t kHeadBytes = 8;

class JournalFileTest : public ::testing::Test {
 protected:
  JournalFileTest() : path_(folder_.File("journal")) {
    auto journal = JournalFile::Create(path_);
    EXPECT_THAT(journal, IsOk());
    for (const std::string& record : records_) journal->Append(record);
    EXPECT_THAT(journal->Sync(), IsOk());
  }

  std::vector<std::string> Read(JournalEnd* end) const {
    std::vector<std::string> read;
    const auto result = ReadJournal(path_, [&](std::string_view record) {
      read.emplace_back(record);
      return OkStatus();
    });
    EXPECT_THAT(result, IsOk());
    if (result.ok()) *end = *result;
    return read;
  }

  const std::vector<std::string> records_ = {"one", "", std::string(300, '\0'), "four"};
  TempDir folder_;
  std::string path_;
};

TEST_F(JournalFileTest, GivesBackWhatWasWritten) {
  JournalEnd end;
  EXPECT_EQ(Read(&end), records_);
  EXPECT_EQ(end.records, records_.size());
  EXPECT_EQ(end.whole_bytes, ReadFile(path_).size());
  EXPECT_EQ(end.cut_bytes, 0u);
  EXPECT_THAT(JournalFile::Create(path_), StatusIs(StatusCode::kAlreadyExists, path_));
}

TEST_F(JournalFileTest, CutOffAnywhereGivesTheWholeRecordsAndGoesOn) {
  const std::string bytes = ReadFile(path_);
  for (std::size_t length = kMagicBytes; length < bytes.size(); ++length) {
    WriteFile(path_, bytes.substr(0, length));
    std::vector<std::string> whole;
    std::size_t whole_bytes = kMagicBytes;
    for (const std::string& record : records_) {
      if (whole_bytes + kHeadBytes + record.size() > length) break;
      whole_bytes += kHeadBytes + record.size();
      whole.push_back(record);
    }
    JournalEnd end;
    ASSERT_EQ(Read(&end), whole) << "cut to " << length << " bytes";
    ASSERT_EQ(end.whole_bytes, whole_bytes);
    ASSERT_EQ(end.cut_bytes, length - whole_bytes);

    auto journal = JournalFile::Resume(path_, end.whole_bytes);
    ASSERT_THAT(journal, IsOk());
    journal->Append("more");
    ASSERT_THAT(journal->Write(), IsOk());
    whole.emplace_back("more");
    ASSERT_EQ(Read(&end), whole) << "resumed at " << length << " bytes";
  }
}

TEST_F(JournalFileTest, FlippedBitEndsTheReadingThere) {
  const std::string bytes = ReadFile(path_);
  for (std::size_t bit = 8 * kMagicBytes; bit < 8 * bytes.size(); ++bit) {
    std::string flipped = bytes;
    flipped[bit / 8] = static_cast<char>(flipped[bit / 8] ^ (1 << (bit % 8)));
    WriteFile(path_, flipped);
    std::size_t sound = 0;
    std::size_t at = kMagicBytes;
    while (at + kHeadBytes + records_[sound].size() <= bit / 8) {
      at += kHeadBytes + records_[sound++].size();
    }
    JournalEnd end;
    ASSERT_EQ(Read(&end).size(), sound) << "bit " << bit;
  }
}

TEST_F(JournalFileTest, SyncsInTheBackgroundWhileItGrows) {
  JournalEnd end;
  std::vector<std::string> expected = Read(&end);
  {
    auto journal = JournalFile::Resume(path_, end.whole_bytes);
    ASSERT_THAT(journal, IsOk());
    for (int i = 0; i < 200; ++i) {
      expected.push_back(std::to_string(i));
      journal->Append(expected.back());
      ASSERT_THAT(journal->StartSync(), IsOk());
    }
    ASSERT_EQ(Read(&end), expected);
    JournalFile moved = *std::move(journal);
    ASSERT_THAT(moved.Sync(), IsOk());
    moved.Append("last");
    ASSERT_THAT(moved.StartSync(), IsOk());
  }
  expected.emplace_back("last");
  EXPECT_EQ(Read(&end), expected);
}

TEST_F(JournalFileTest, ADiskThatStaysFullCostsWhatComesLaterAndNoMemory) {
  auto journal = JournalFile::Resume(path_, ReadFile(path_).size());
  ASSERT_THAT(journal, IsOk());
  const auto former = std::signal(SIGXFSZ, SIG_IGN);
  rlimit full{};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &full), 0);
  const rlimit limit{ReadFile(path_).size() + 1000, full.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &limit), 0);
  const std::string large(JournalFile::kMaxRecordBytes, 'x');
  for (int i = 0; i < 40; ++i) journal->Append(large);
  EXPECT_THAT(journal->Write(), StatusIs(StatusCode::kUnavailable, "cannot write"));
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &full), 0);
  std::signal(SIGXFSZ, former);
  EXPECT_THAT(journal->Write(), StatusIs(StatusCode::kUnavailable, "the rest of the shift"));
  journal->Append("later");
  EXPECT_THAT(journal->Sync(), StatusIs(StatusCode::kUnavailable, "the rest of the shift"));
  JournalEnd end;
  const std::vector<std::string> read = Read(&end);
  ASSERT_EQ(read.size(), records_.size() + 15);
  EXPECT_EQ(read.back(), large);
  EXPECT_EQ(end.cut_bytes, 0u);
}

TEST_F(JournalFileTest, OtherFilesAreNoJournals) {
  const auto take = [](std::string_view) { return OkStatus(); };
  WriteFile(path_, "SHMJRNL9 and more");
  EXPECT_THAT(ReadJournal(path_, take), StatusIs(StatusCode::kDataLoss, "does not begin"));
  WriteFile(path_, "SHM");
  EXPECT_THAT(ReadJournal(path_, take), StatusIs(StatusCode::kDataLoss, "does not begin"));
  EXPECT_THAT(ReadJournal(folder_.File("none"), take), StatusIs(StatusCode::kNotFound, "none"));
}

}  // namespace
}  // namespace shiftmap::live
