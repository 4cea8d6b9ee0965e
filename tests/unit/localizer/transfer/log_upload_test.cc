// SPDX-License-Identifier: Apache-2.0
#include "localizer/transfer/log_upload.h"

#include <gtest/gtest.h>

#include "mapstore/map/sha256.h"
#include "tests/unit/localizer/transfer/transfer_fixture.h"

namespace shiftmap::transfer {
namespace {

using ::shiftmap::testing::IsOk;
using ::shiftmap::testing::StatusIs;
using ::shiftmap::testing::WriteFile;

constexpr int kUnavailableCode = 14;

class LogUploadTest : public TransferTest {
 protected:
  LogUploadTest() : log_(folder_.File("run.mcap")) {
    std::mt19937_64 random(7);
    for (int i = 0; i < 300'000; ++i) bytes_ += static_cast<char>(random());
    WriteFile(log_, bytes_);
    options_.backoff = {.first_s = 0.001, .longest_s = 0.005, .give_up_s = 5.0};
  }

  StatusOr<UploadResult> Upload() {
    MapClient client = Client();
    return UploadLog(&client, log_, options_);
  }

  void ExpectWhole() {
    ASSERT_EQ(server_.logs().size(), 1u);
    EXPECT_TRUE(server_.logs().begin()->second == bytes_);
  }

  std::string log_;
  std::string bytes_;
  UploadOptions options_;
};

TEST_F(LogUploadTest, InPiecesAndASecondTimeItIsKnown) {
  options_.piece_bytes = 70'000;
  const StatusOr<UploadResult> first = Upload();
  ASSERT_THAT(first, IsOk());
  EXPECT_FALSE(first->known_already);
  EXPECT_EQ(first->sent_bytes, 300'000);
  ExpectWhole();
  const StatusOr<UploadResult> again = Upload();
  ASSERT_THAT(again, IsOk());
  EXPECT_TRUE(again->known_already);
}

TEST_F(LogUploadTest, GoesOnFromWhatArrivedWhenStreamsAreCut) {
  server_.CutStreamsAfter(50'000);
  const StatusOr<UploadResult> result = Upload();
  ASSERT_THAT(result, IsOk());
  EXPECT_GE(result->retries, 3);
  ExpectWhole();
}

TEST_F(LogUploadTest, AnAnswerThatWasLostIsNoSecondUpload) {
  server_.FailNext(1, kUnavailableCode, /*late=*/true);
  const StatusOr<UploadResult> result = Upload();
  ASSERT_THAT(result, IsOk());
  EXPECT_EQ(result->sent_bytes, 300'000);
  ExpectWhole();
}

TEST_F(LogUploadTest, BytesThatTheServerHasWronglyAreDroppedThereAndSentAgain) {
  Sha256 hash;
  hash.Update(bytes_);
  server_.StoreBytes(hash.HexDigest(), std::string(1000, 'x'));
  const StatusOr<UploadResult> result = Upload();
  ASSERT_THAT(result, IsOk());
  EXPECT_EQ(result->retries, 1);
  ExpectWhole();
}

TEST_F(LogUploadTest, AFileThatShrankIsRefused) {
  StatusOr<LogUpload> upload = LogUpload::Open(log_);
  ASSERT_THAT(upload, IsOk());
  WriteFile(log_, "short");
  MapClient client = Client();
  RateLimit limit(0.0);
  EXPECT_THAT(upload->SendPiece(&client, &limit, 1 << 20),
              StatusIs(StatusCode::kInvalidArgument, "shorter"));
}

TEST_F(LogUploadTest, ARefusalIsNotTriedAgain) {
  Sha256 hash;
  hash.Update(bytes_);
  server_.Refuse(hash.HexDigest());
  EXPECT_THAT(Upload(), StatusIs(StatusCode::kInvalidArgument, log_));
  EXPECT_EQ(server_.calls(), 2);
}

}  // namespace
}  // namespace shiftmap::transfer
