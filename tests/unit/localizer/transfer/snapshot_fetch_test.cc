// SPDX-License-Identifier: Apache-2.0
#include "localizer/transfer/snapshot_fetch.h"

#include <gtest/gtest.h>

#include <filesystem>

#include "tests/unit/localizer/transfer/transfer_fixture.h"

namespace shiftmap::transfer {
namespace {

using ::shiftmap::testing::IsOk;
using ::shiftmap::testing::ReadFile;
using ::shiftmap::testing::StatusIs;
using ::shiftmap::testing::WriteFile;

constexpr int kUnavailableCode = 14;

class SnapshotFetchTest : public TransferTest {
 protected:
  SnapshotFetchTest() {
    options_.area = "floor";
    options_.output = folder_.File("floor.db");
    options_.backoff = {.first_s = 0.001, .longest_s = 0.005, .give_up_s = 5.0};
  }

  StatusOr<FetchResult> Fetch() {
    MapClient client = Client();
    return FetchSnapshot(&client, options_);
  }

  FetchOptions options_;
};

TEST_F(SnapshotFetchTest, APlacedSnapshotIsTheServersByteByByteAndIsNotFetchedAgain) {
  const auto made = Made(1);
  server_.Publish(made);
  const StatusOr<FetchResult> first = Fetch();
  ASSERT_THAT(first, IsOk());
  EXPECT_FALSE(first->not_changed);
  EXPECT_EQ(first->received_bytes, static_cast<std::int64_t>(made.bytes.size()));
  EXPECT_TRUE(ReadFile(options_.output) == made.bytes);
  const StatusOr<FetchResult> again = Fetch();
  ASSERT_THAT(again, IsOk());
  EXPECT_TRUE(again->not_changed);
  EXPECT_EQ(again->received_bytes, 0);
}

TEST_F(SnapshotFetchTest, AStreamThatIsCutAgainAndAgainSendsNoByteTwice) {
  const auto made = Made(1);
  server_.Publish(made);
  server_.CutStreamsAfter(10'000);
  const StatusOr<FetchResult> result = Fetch();
  ASSERT_THAT(result, IsOk());
  EXPECT_GE(result->retries, static_cast<int>(made.bytes.size() / 20'000));
  EXPECT_EQ(result->received_bytes, static_cast<std::int64_t>(made.bytes.size()));
  EXPECT_TRUE(ReadFile(options_.output) == made.bytes);
}

TEST_F(SnapshotFetchTest, AnotherProcessGoesOnWhereOneEnded) {
  const auto made = Made(1);
  server_.Publish(made);
  server_.CutStreamsAfter(10'000);
  options_.backoff.give_up_s = 0.0;
  EXPECT_THAT(Fetch(), StatusIs(StatusCode::kUnavailable, "cut"));
  EXPECT_FALSE(std::filesystem::exists(options_.output));
  const auto here = static_cast<std::int64_t>(ReadFile(options_.output + ".part").size());
  EXPECT_GT(here, 0);
  server_.CutStreamsAfter(0);
  const StatusOr<FetchResult> result = Fetch();
  ASSERT_THAT(result, IsOk());
  EXPECT_EQ(result->resumed_bytes, here);
  EXPECT_EQ(result->received_bytes, static_cast<std::int64_t>(made.bytes.size()) - here);
  EXPECT_TRUE(ReadFile(options_.output) == made.bytes);
}

TEST_F(SnapshotFetchTest, BytesThatAPowerFailureTookAreFetchedAgain) {
  const auto made = Made(1);
  server_.Publish(made);
  server_.CutStreamsAfter(10'000);
  options_.backoff.give_up_s = 0.0;
  EXPECT_FALSE(Fetch().ok());
  std::string part = ReadFile(options_.output + ".part");
  part.replace(part.size() / 2, 100, std::string(100, '\0'));
  WriteFile(options_.output + ".part", part);
  server_.CutStreamsAfter(0);
  options_.backoff.give_up_s = 5.0;
  ASSERT_THAT(Fetch(), IsOk());
  EXPECT_TRUE(ReadFile(options_.output) == made.bytes);
}

TEST_F(SnapshotFetchTest, ABegunSnapshotOfTheSameMapIsFinishedAndOneOfAnotherMapIsNot) {
  auto old = Made(1);
  server_.Publish(old);
  server_.CutStreamsAfter(10'000);
  options_.backoff.give_up_s = 0.0;
  EXPECT_FALSE(Fetch().ok());
  server_.CutStreamsAfter(0);
  auto more_rows = Made(1);
  more_rows.bytes += "rows";
  more_rows.ledger_sequence = 5;
  server_.Publish(more_rows);
  const StatusOr<FetchResult> finished = Fetch();
  ASSERT_THAT(finished, IsOk());
  EXPECT_EQ(finished->snapshot.ledger_sequence.value(), 0);
  EXPECT_TRUE(ReadFile(options_.output) == old.bytes);

  const auto other = Made(2);
  server_.Publish(other);
  const StatusOr<FetchResult> newest = Fetch();
  ASSERT_THAT(newest, IsOk());
  EXPECT_EQ(newest->resumed_bytes, 0);
  EXPECT_TRUE(ReadFile(options_.output) == other.bytes);
}

TEST_F(SnapshotFetchTest, AMapThatIsNotTheOneAnnouncedIsNotPlaced) {
  auto made = Made(1);
  made.content_hash = std::string(64, 'f');
  server_.Publish(made);
  EXPECT_THAT(Fetch(), StatusIs(StatusCode::kDataLoss, "content"));
  made = Made(1);
  made.bytes = "no map";
  server_.Publish(made);
  EXPECT_FALSE(Fetch().ok());
  EXPECT_FALSE(std::filesystem::exists(options_.output));
  EXPECT_FALSE(std::filesystem::exists(options_.output + ".part"));
}

TEST_F(SnapshotFetchTest, TemporaryErrorsAreTriedAgainAndOthersAreNot) {
  server_.Publish(Made(1));
  server_.FailNext(3, kUnavailableCode);
  const StatusOr<FetchResult> result = Fetch();
  ASSERT_THAT(result, IsOk());
  EXPECT_EQ(result->retries, 3);
  const int calls = server_.calls();
  options_.area = "yard";
  EXPECT_THAT(Fetch(), StatusIs(StatusCode::kNotFound, "no such area"));
  EXPECT_EQ(server_.calls(), calls + 1);
}

TEST_F(SnapshotFetchTest, ADryRunWritesNothing) {
  server_.Publish(Made(1));
  options_.dry_run = true;
  ASSERT_THAT(Fetch(), IsOk());
  EXPECT_TRUE(std::filesystem::is_empty(folder_.path()));
}

}  // namespace
}  // namespace shiftmap::transfer
