// SPDX-License-Identifier: Apache-2.0
#include "mapstore/server/upload_spool.h"

#include <gtest/gtest.h>

#include <filesystem>

#include "mapstore/codec/run_log.h"
#include "mapstore/map/sha256.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace shiftmap::server {
namespace {

using shiftmap::testing::IsOk;
using shiftmap::testing::ReadFile;
using shiftmap::testing::StatusIs;
using shiftmap::testing::TempDir;

constexpr const char* kUuid = "0f8fad5b-d9cb-469f-a165-70867728950e";

std::string Sha256Of(const std::string& bytes) {
  Sha256 hash;
  hash.Update(bytes);
  return hash.HexDigest();
}

class UploadSpoolTest : public ::testing::Test {
 protected:
  // A log of a run. @param speed  Tells recordings of one run apart.
  std::string Log(const std::string& uuid, double speed = 1.0) const {
    shiftmap::Run run;
    run.info = {"truck/7", "test", uuid, "floor"};
    for (int i = 0; i < 50; ++i) run.odometry.push_back({StampFromSeconds(i), speed, 0.0});
    EXPECT_THAT(WriteRunLog(run, dir_.File("a.mcap")), IsOk());
    return ReadFile(dir_.File("a.mcap"));
  }

  std::unique_ptr<UploadSpool> Open(const UploadLimits& limits) const {
    StatusOr<std::unique_ptr<UploadSpool>> spool = UploadSpool::Open(logs_, limits);
    EXPECT_THAT(spool, IsOk());
    return *std::move(spool);
  }

  static StatusOr<UploadProgress> Send(UploadSpool& spool,
                                       const std::string& log,
                                       std::size_t begin,
                                       std::size_t end,
                                       const Status& accepted = OkStatus()) {
    SHIFTMAP_ASSIGN_OR_RETURN(UploadSpool::Upload upload,
                              spool.Begin("client",
                                          Sha256Of(log),
                                          static_cast<std::int64_t>(log.size()),
                                          static_cast<std::int64_t>(begin)));
    SHIFTMAP_RETURN_IF_ERROR(upload.Append(log.substr(begin, end - begin)));
    return spool.Finish(std::move(upload), [&](const RunInfo&) { return accepted; });
  }

  TempDir dir_;
  std::string logs_ = dir_.File("logs");
  UploadLimits limits_ = [] {
    UploadLimits limits;
    limits.keep_free_bytes = 0;
    return limits;
  }();
};

TEST_F(UploadSpoolTest, ALogLiesUnderItsVehicleAndRunOnce) {
  const auto spool = Open(limits_);
  const std::string log = Log(kUuid);
  const auto half = Send(*spool, log, 0, log.size() / 2);
  ASSERT_THAT(half, IsOk());
  EXPECT_FALSE(half->complete);
  const auto whole = Send(*spool, log, log.size() / 2, log.size());
  ASSERT_THAT(whole, IsOk());
  EXPECT_TRUE(whole->complete);
  const std::string place = logs_ + "/truck=2F7/" + kUuid + ".mcap";
  EXPECT_EQ(ReadFile(place), log);
  EXPECT_TRUE(spool->Progress("client", Sha256Of(log))->complete);
  EXPECT_THAT(Send(*spool, log, 0, log.size()), StatusIs(StatusCode::kAlreadyExists, "already"));
  // Also after the nightly job took it away.
  std::filesystem::remove(place);
  EXPECT_TRUE(Open(limits_)->Progress("client", Sha256Of(log))->complete);
}

TEST_F(UploadSpoolTest, AnotherRecordingOfARunTakesNothingAway) {
  const auto spool = Open(limits_);
  const std::string first = Log(kUuid);
  const std::string second = Log(kUuid, 2.0);
  ASSERT_THAT(Send(*spool, first, 0, first.size()), IsOk());
  ASSERT_THAT(Send(*spool, second, 0, second.size()), IsOk());
  EXPECT_EQ(ReadFile(logs_ + "/truck=2F7/" + kUuid + ".mcap"), first);
  EXPECT_EQ(ReadFile(logs_ + "/truck=2F7/" + Sha256Of(second) + ".mcap"), second);
}

TEST_F(UploadSpoolTest, ALaterUploadOfALogTakesThePlaceOfOneThatHangs) {
  const auto spool = Open(limits_);
  const std::string log = Log("");
  const auto size = static_cast<std::int64_t>(log.size());
  auto hanging = spool->Begin("client", Sha256Of(log), size, 0);
  ASSERT_THAT(hanging, IsOk());
  ASSERT_THAT(hanging->Append(log.substr(0, 100)), IsOk());
  auto later = spool->Begin("client", Sha256Of(log), size, 100);
  ASSERT_THAT(later, IsOk());
  EXPECT_THAT(hanging->Append("x"), StatusIs(StatusCode::kAborted, "another upload"));
  ASSERT_THAT(later->Append(log.substr(100)), IsOk());
  EXPECT_THAT(later->Append("x"), StatusIs(StatusCode::kInvalidArgument, "more than"));
  EXPECT_THAT(spool->Finish(*std::move(later), [](const RunInfo&) { return OkStatus(); }), IsOk());
  EXPECT_EQ(ReadFile(logs_ + "/truck=2F7/" + Sha256Of(log) + ".mcap"), log);
}

TEST_F(UploadSpoolTest, ALogThatCannotBeTakenNowStaysAndOneThatMayNotGoes) {
  const auto spool = Open(limits_);
  const std::string log = Log(kUuid);
  EXPECT_THAT(Send(*spool, log, 0, log.size(), Unavailable("busy")),
              StatusIs(StatusCode::kUnavailable, "busy"));
  EXPECT_EQ(spool->Progress("client", Sha256Of(log))->stored_bytes,
            static_cast<std::int64_t>(log.size()));
  // Nothing is missing but the end.
  EXPECT_THAT(Send(*spool,
                   log,
                   log.size(),
                   log.size(),
                   MakeStatus(StatusCode::kPermissionDenied, "another vehicle")),
              StatusIs(StatusCode::kPermissionDenied, "another"));
  EXPECT_EQ(spool->Progress("client", Sha256Of(log))->stored_bytes, 0);
  EXPECT_FALSE(std::filesystem::exists(logs_ + "/truck=2F7"));
}

TEST_F(UploadSpoolTest, WhatIsNoLogIsRefusedByItsHashAndNotByAPathOfTheServer) {
  const auto spool = Open(limits_);
  const std::string junk(5000, 'x');
  const Status refused = Send(*spool, junk, 0, junk.size()).status();
  EXPECT_THAT(refused, StatusIs(StatusCode::kInvalidArgument, Sha256Of(junk)));
  EXPECT_THAT(Message(refused), ::testing::Not(::testing::HasSubstr(logs_)));
  EXPECT_EQ(spool->Progress("client", Sha256Of(junk))->stored_bytes, 0);
}

TEST_F(UploadSpoolTest, QuotasRefuseBeforeAByteIsTaken) {
  const std::string log = Log(kUuid);
  const auto size = static_cast<std::int64_t>(log.size());
  UploadLimits limits = limits_;
  limits.max_log_bytes = size - 1;
  EXPECT_THAT(Send(*Open(limits), log, 0, 1), StatusIs(StatusCode::kInvalidArgument, "at most"));
  limits = limits_;
  limits.max_client_bytes = size - 1;
  EXPECT_THAT(Send(*Open(limits), log, 0, 1), StatusIs(StatusCode::kResourceExhausted, "quota"));
  limits = limits_;
  limits.max_folder_bytes = size - 1;
  EXPECT_THAT(Send(*Open(limits), log, 0, 1), StatusIs(StatusCode::kResourceExhausted, "quota"));
  limits = limits_;
  limits.keep_free_bytes = INT64_MAX / 2;
  EXPECT_THAT(Send(*Open(limits), log, 0, 1), StatusIs(StatusCode::kResourceExhausted, "left"));
  EXPECT_EQ(Open(limits_)->Progress("client", Sha256Of(log))->stored_bytes, 0);
}

// What is on its way counts as if it were there.
TEST_F(UploadSpoolTest, UploadsAtOneTimeStayWithinTheQuotaTogether) {
  const std::string log = Log(kUuid);
  const std::string other = Log("", 2.0);
  const auto size = static_cast<std::int64_t>(log.size());
  const auto other_size = static_cast<std::int64_t>(other.size());
  const auto begin = [&](UploadSpool& spool, const std::string& client) {
    return spool.Begin(client, Sha256Of(other), other_size, 0).status();
  };
  for (const bool of_client : {true, false}) {
    UploadLimits limits = limits_;
    (of_client ? limits.max_client_bytes : limits.max_folder_bytes) = size + other_size - 1;
    const auto spool = Open(limits);
    {
      auto upload = spool->Begin("client", Sha256Of(log), size, 0);
      ASSERT_THAT(upload, IsOk());
      EXPECT_THAT(begin(*spool, "client"), StatusIs(StatusCode::kResourceExhausted, "quota"));
      const Status of_another = begin(*spool, "another");
      EXPECT_EQ(of_another.ok(), of_client) << Message(of_another);
      ASSERT_THAT(upload->Append(log.substr(0, 10)), IsOk());
      EXPECT_THAT(begin(*spool, "client"), StatusIs(StatusCode::kResourceExhausted, "quota"));
    }
    // It was cut: what it had reserved is free again.
    EXPECT_THAT(begin(*spool, "client"), IsOk());
    std::filesystem::remove_all(logs_);
  }
}

// The hash is kept while bytes come. The oracle is that of the whole file.
TEST_F(UploadSpoolTest, ManyUploadsOfOneLogGiveItsHashAlsoAfterARestart) {
  const std::string log = Log(kUuid);
  std::unique_ptr<UploadSpool> spool = Open(limits_);
  const std::size_t step = log.size() / 7 + 1;
  for (std::size_t at = 0; at < log.size(); at += step) {
    if (at == 3 * step) spool = Open(limits_);
    const auto sent = Send(*spool, log, at, std::min(log.size(), at + step));
    ASSERT_THAT(sent, IsOk());
    EXPECT_EQ(sent->complete, at + step >= log.size());
  }
  EXPECT_EQ(ReadFile(logs_ + "/truck=2F7/" + kUuid + ".mcap"), log);
}

TEST_F(UploadSpoolTest, ALogWithAnotherHashIsDroppedWholeOrPieceByPiece) {
  const std::string log = Log(kUuid);
  std::string wrong = log;
  wrong[log.size() / 2] = static_cast<char>(wrong[log.size() / 2] ^ 1);
  const auto size = static_cast<std::int64_t>(log.size());
  for (const std::size_t cut : {log.size(), log.size() / 3}) {
    const auto spool = Open(limits_);
    StatusOr<UploadProgress> sent = UploadProgress();
    for (std::size_t at = 0; at < log.size(); at = at < cut ? cut : log.size()) {
      auto upload = spool->Begin("client", Sha256Of(log), size, static_cast<std::int64_t>(at));
      ASSERT_THAT(upload, IsOk());
      ASSERT_THAT(upload->Append(wrong.substr(at, at < cut ? cut - at : std::string::npos)),
                  IsOk());
      sent = spool->Finish(*std::move(upload), [](const RunInfo&) { return OkStatus(); });
    }
    EXPECT_THAT(sent.status(), StatusIs(StatusCode::kDataLoss, "has the hash"));
    EXPECT_EQ(spool->Progress("client", Sha256Of(log))->stored_bytes, 0);
    // What comes next begins anew.
    EXPECT_TRUE(Send(*spool, log, 0, log.size())->complete);
    std::filesystem::remove_all(logs_);
  }
}

TEST_F(UploadSpoolTest, APartThatNobodyGoesOnWithIsRemovedAfterItsTime) {
  const std::string log = Log(kUuid);
  ASSERT_THAT(Send(*Open(limits_), log, 0, 100), IsOk());
  const auto spool = Open(limits_);
  EXPECT_EQ(spool->Progress("client", Sha256Of(log))->stored_bytes, 100);
  EXPECT_EQ(spool->folder_bytes(), 100);
  std::filesystem::last_write_time(
      logs_ + "/.uploads/client/" + Sha256Of(log) + ".part",
      std::filesystem::file_time_type::clock::now() - std::chrono::hours(24 * 8));
  spool->Maintain();
  EXPECT_EQ(spool->Progress("client", Sha256Of(log))->stored_bytes, 0);
  EXPECT_EQ(spool->folder_bytes(), 0);
}

// The disk fails between the word that the log was whole and its place. The bytes are all there is
// of it: once they are gone, nobody may be told that it is here.
TEST_F(UploadSpoolTest, ALogThatFoundNoPlaceIsNotHereOnceItsPartIsRemoved) {
  const std::string log = Log("");
  const std::string sha256 = Sha256Of(log);
  const auto spool = Open(limits_);
  std::filesystem::create_directories(logs_ + "/truck=2F7/" + sha256 + ".mcap/in the way");
  EXPECT_THAT(Send(*spool, log, 0, log.size()), StatusIs(StatusCode::kUnavailable, ""));
  EXPECT_EQ(spool->Progress("client", sha256)->stored_bytes, static_cast<std::int64_t>(log.size()));
  std::filesystem::last_write_time(
      logs_ + "/.uploads/client/" + sha256 + ".part",
      std::filesystem::file_time_type::clock::now() - std::chrono::hours(24 * 8));
  spool->Maintain();
  EXPECT_FALSE(spool->Progress("client", sha256)->complete);
}

}  // namespace
}  // namespace shiftmap::server
