// SPDX-License-Identifier: Apache-2.0
#include "localizer/transfer/outbox.h"

#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>

#include "mapstore/codec/shift_report.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace shiftmap::transfer {
namespace {

namespace fs = std::filesystem;
using ::shiftmap::testing::IsOk;
using ::shiftmap::testing::StatusIs;
using ::shiftmap::testing::TempDir;
using ::shiftmap::testing::WriteFile;

class OutboxTest : public ::testing::Test {
 protected:
  OutboxTest() {
    options_.files = files_.path();
    options_.record = record_.path();
    options_.warn = [this](const std::string& line) { warnings_.push_back(line); };
  }

  Outbox Opened() {
    StatusOr<Outbox> outbox = Outbox::Open(options_);
    EXPECT_THAT(outbox, IsOk());
    EXPECT_THAT(outbox->Scan(), IsOk());
    return *std::move(outbox);
  }

  // A file of a shift; later ones are written a second later.
  std::string Left(const std::string& ending, std::size_t bytes = 10) {
    const std::string name = RandomUuid() + ending;
    WriteFile(files_.File(name), std::string(bytes, 'x'));
    const auto epoch = fs::file_time_type::clock::now() - std::chrono::hours(1);
    fs::last_write_time(files_.File(name), epoch + std::chrono::seconds(++left_));
    return name;
  }

  static std::vector<std::string> Names(const std::vector<OutboxItem>& items) {
    std::vector<std::string> names;
    for (const OutboxItem& item : items) names.push_back(item.name);
    return names;
  }

  TempDir files_;
  TempDir record_;
  OutboxOptions options_;
  std::vector<std::string> warnings_;
  int left_ = 0;
};

TEST_F(OutboxTest, ReportsGoBeforeLogsAndTheOldestFirst) {
  const std::string old_log = Left(".mcap");
  const std::string old_report = Left(".report");
  const std::string log = Left(".mcap");
  const std::string report = Left(".report");
  WriteFile(files_.File("shift.journal"), "x");
  WriteFile(files_.File("x.report"), "x");
  WriteFile(files_.File(RandomUuid() + ".report.tmp-0"), "x");
  const std::vector<std::string> expected = {old_report, report, old_log, log};
  EXPECT_EQ(Names(Opened().Waiting()), expected);
}

TEST_F(OutboxTest, AcknowledgedFilesAreDeletedAndRememberedOverARestart) {
  const std::string report = Left(".report");
  const std::string log = Left(".mcap");
  {
    Outbox outbox = Opened();
    ASSERT_THAT(outbox.Acknowledge(report), IsOk());
    EXPECT_FALSE(fs::exists(files_.File(report)));
    ASSERT_THAT(outbox.Refuse(log, "of <another> vehicle\n"), IsOk());
  }
  Outbox outbox = Opened();
  EXPECT_TRUE(outbox.Waiting().empty());
  EXPECT_EQ(outbox.items().at(report).state, OutboxState::kAcknowledged);
  EXPECT_EQ(outbox.items().at(log).state, OutboxState::kRefused);
  EXPECT_EQ(outbox.items().at(log).reason, "of <another> vehicle\n");
  EXPECT_TRUE(fs::exists(files_.File(log)));
  ASSERT_THAT(outbox.ForgetRefusals(), IsOk());
  EXPECT_EQ(Names(outbox.Waiting()), std::vector<std::string>{log});
}

// The process ended between the record and the deletion.
TEST_F(OutboxTest, AnAcknowledgedFileThatIsStillThereIsDeletedAndNotHandedInAgain) {
  const std::string report = Left(".report");
  const TempDir aside;
  {
    Outbox outbox = Opened();
    fs::copy_file(files_.File(report), aside.File("copy"));
    fs::last_write_time(aside.File("copy"), fs::last_write_time(files_.File(report)));
    ASSERT_THAT(outbox.Acknowledge(report), IsOk());
  }
  fs::rename(aside.File("copy"), files_.File(report));
  const Outbox outbox = Opened();
  EXPECT_TRUE(outbox.Waiting().empty());
  EXPECT_FALSE(fs::exists(files_.File(report)));
}

TEST_F(OutboxTest, BeyondTheBoundRefusedOnesGoThenOldLogsThenReportsAndItIsSaid) {
  constexpr std::size_t kMib = std::size_t{1} << 20;
  options_.max_bytes = 3 * kMib;
  const std::string report = Left(".report", kMib);
  const std::string old_log = Left(".mcap", kMib);
  const std::string refused = Left(".mcap", kMib);
  {
    Outbox outbox = Opened();
    ASSERT_THAT(outbox.Refuse(refused, "no"), IsOk());
  }
  EXPECT_TRUE(warnings_.empty());
  const std::string log = Left(".mcap", kMib);
  {
    Outbox outbox = Opened();
    EXPECT_EQ(outbox.items().at(refused).state, OutboxState::kLost);
    EXPECT_FALSE(fs::exists(files_.File(refused)));
    const std::vector<std::string> left = {report, old_log, log};
    EXPECT_EQ(Names(outbox.Waiting()), left);
  }
  options_.max_bytes = kMib;
  const Outbox outbox = Opened();
  EXPECT_EQ(Names(outbox.Waiting()), std::vector<std::string>{report});
  ASSERT_EQ(warnings_.size(), 3u);
  EXPECT_NE(warnings_[0].find(refused), std::string::npos);
  EXPECT_NE(warnings_[1].find(old_log + "', which was not handed in"), std::string::npos);
  EXPECT_EQ(outbox.items().at(log).state, OutboxState::kLost);
}

TEST_F(OutboxTest, AFileThatSomebodyElseDeletedIsSaid) {
  const std::string log = Left(".mcap");
  Outbox outbox = Opened();
  fs::remove(files_.File(log));
  ASSERT_THAT(outbox.Scan(), IsOk());
  EXPECT_EQ(outbox.items().at(log).state, OutboxState::kLost);
  ASSERT_EQ(warnings_.size(), 1u);
  EXPECT_NE(warnings_[0].find(log), std::string::npos);
  ASSERT_THAT(outbox.Scan(), IsOk());
  EXPECT_EQ(warnings_.size(), 1u);
}

TEST_F(OutboxTest, AFileThatWasWrittenAgainWaitsAgain) {
  const std::string report = Left(".report");
  Outbox outbox = Opened();
  ASSERT_THAT(outbox.Refuse(report, "no"), IsOk());
  WriteFile(files_.File(report), "another one");
  ASSERT_THAT(outbox.Scan(), IsOk());
  EXPECT_EQ(Names(outbox.Waiting()), std::vector<std::string>{report});
}

TEST_F(OutboxTest, TheRecordIsBounded) {
  options_.max_items = 5;
  Outbox outbox = Opened();
  for (int i = 0; i < 9; ++i) {
    const std::string report = Left(".report");
    ASSERT_THAT(outbox.Scan(), IsOk());
    ASSERT_THAT(outbox.Acknowledge(report), IsOk());
  }
  EXPECT_EQ(outbox.items().size(), 5u);
}

TEST_F(OutboxTest, OneProcessHasTheRecord) {
  const Outbox outbox = Opened();
  EXPECT_THAT(Outbox::Open(options_), StatusIs(StatusCode::kUnavailable, "another process"));
}

TEST_F(OutboxTest, ADamagedRecordIsSetAsideAndFilesAreHandedInOnceMore) {
  const std::string report = Left(".report");
  for (const char* text : {"", "{", "{\"items\": [3]}", "{\"items\": [{\"name\": \"x\"}]}"}) {
    WriteFile(record_.File("outbox.json"), text);
    warnings_.clear();
    EXPECT_EQ(Names(Opened().Waiting()), std::vector<std::string>{report}) << text;
    EXPECT_EQ(warnings_.size(), 1u);
    EXPECT_EQ(testing::ReadFile(record_.File("outbox.json.damaged")), text);
  }
}

}  // namespace
}  // namespace shiftmap::transfer
