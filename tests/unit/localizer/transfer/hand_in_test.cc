// SPDX-License-Identifier: Apache-2.0
#include "localizer/transfer/hand_in.h"

#include <gtest/gtest.h>

#include <filesystem>

#include "tests/unit/localizer/transfer/transfer_fixture.h"

namespace shiftmap::transfer {
namespace {

namespace fs = std::filesystem;
using ::shiftmap::testing::IsOk;
using ::shiftmap::testing::StatusIs;
using ::shiftmap::testing::WriteFile;

constexpr int kUnavailableCode = 14;
constexpr int kExhaustedCode = 8;

class HandInTest : public TransferTest {
 protected:
  HandInTest() {
    outbox_options_.files = folder_.path();
    outbox_options_.record = record_.path();
    StatusOr<Outbox> outbox = Outbox::Open(outbox_options_);
    EXPECT_THAT(outbox, IsOk());
    outbox_.emplace(*std::move(outbox));
    options_.server = ToServer();
    options_.piece_bytes = 50'000;
  }

  std::string LeaveReport() {
    const ShiftReport report = Report();
    EXPECT_THAT(WriteShiftReport(report, folder_.File(report.uuid + ".report")), IsOk());
    return report.uuid;
  }

  std::string LeaveLog(char fill) {
    const std::string name = RandomUuid() + ".mcap";
    WriteFile(folder_.File(name), std::string(200'000, fill));
    return name;
  }

  OutboxState StateOf(const std::string& name) { return outbox_->items().at(name).state; }

  testing::TempDir record_;
  OutboxOptions outbox_options_;
  std::optional<Outbox> outbox_;
  HandInOptions options_;
};

TEST_F(HandInTest, EverythingIsHandedInAndDeleted) {
  const std::string uuid = LeaveReport();
  LeaveLog('a');
  LeaveLog('b');
  HandIn hand_in(&*outbox_, options_);
  ASSERT_THAT(hand_in.Pass({}), IsOk());
  EXPECT_EQ(hand_in.counts().reports, 1);
  EXPECT_EQ(hand_in.counts().logs, 2);
  EXPECT_EQ(server_.reports(), (std::map<std::string, int>{{uuid, 1}}));
  EXPECT_EQ(server_.logs().size(), 2u);
  EXPECT_TRUE(fs::is_empty(folder_.path()));
}

TEST_F(HandInTest, AReportThatComesWhileALogIsOnItsWayGoesFirst) {
  const std::string log = LeaveLog('a');
  std::string uuid;
  bool log_was_waiting = false;
  options_.alive = [&] {
    if (uuid.empty() && server_.calls() > 0) uuid = LeaveReport();
  };
  options_.inform = [&](const std::string& line) {
    if (line.starts_with("report")) log_was_waiting = StateOf(log) == OutboxState::kWaiting;
  };
  HandIn hand_in(&*outbox_, options_);
  ASSERT_THAT(hand_in.Pass({}), IsOk());
  EXPECT_EQ(server_.reports().count(uuid), 1u);
  EXPECT_TRUE(log_was_waiting);
}

TEST_F(HandInTest, ALostAnswerIsHandedInAgainAndCountsOnce) {
  const std::string uuid = LeaveReport();
  server_.FailNext(1, kUnavailableCode, /*late=*/true);
  HandIn hand_in(&*outbox_, options_);
  EXPECT_THAT(hand_in.Pass({}), StatusIs(StatusCode::kUnavailable, ""));
  EXPECT_TRUE(fs::exists(folder_.File(uuid + ".report")));
  ASSERT_THAT(hand_in.Pass({}), IsOk());
  EXPECT_EQ(server_.reports()[uuid], 2);
  EXPECT_EQ(hand_in.counts().reports, 1);
}

TEST_F(HandInTest, ARefusedReportStaysAndHoldsNothingUp) {
  const std::string refused = LeaveReport();
  server_.Refuse(refused);
  const std::string other = LeaveReport();
  WriteFile(folder_.File(RandomUuid() + ".report"), "no report");
  HandIn hand_in(&*outbox_, options_);
  ASSERT_THAT(hand_in.Pass({}), IsOk());
  EXPECT_EQ(hand_in.counts().refused, 2);
  EXPECT_EQ(hand_in.counts().reports, 1);
  EXPECT_EQ(StateOf(refused + ".report"), OutboxState::kRefused);
  EXPECT_NE(outbox_->items().at(refused + ".report").reason.find("report refused"),
            std::string::npos);
  EXPECT_TRUE(fs::exists(folder_.File(refused + ".report")));
  EXPECT_EQ(server_.reports().count(other), 1u);
  const int calls = server_.calls();
  ASSERT_THAT(hand_in.Pass({}), IsOk());
  EXPECT_EQ(server_.calls(), calls);
}

TEST_F(HandInTest, AFileThatTheServerHasNoRoomForIsPassedOverUntilTheNextPass) {
  LeaveReport();
  LeaveReport();
  server_.FailNext(1, kExhaustedCode);
  HandIn hand_in(&*outbox_, options_);
  EXPECT_THAT(hand_in.Pass({}), StatusIs(StatusCode::kResourceExhausted, ""));
  EXPECT_EQ(hand_in.counts().reports, 1);
  ASSERT_THAT(hand_in.Pass({}), IsOk());
  EXPECT_EQ(hand_in.counts().reports, 2);
}

}  // namespace
}  // namespace shiftmap::transfer
