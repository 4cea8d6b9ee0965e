// SPDX-License-Identifier: Apache-2.0
#include "localizer/transfer/map_client.h"

#include <gtest/gtest.h>

#include <set>
#include <thread>

#include "tests/unit/localizer/transfer/transfer_fixture.h"

namespace shiftmap::transfer {
namespace {

using ::shiftmap::testing::IsOk;
using ::shiftmap::testing::StatusIs;

using MapClientTest = TransferTest;

TEST_F(MapClientTest, NobodyThereIsTemporary) {
  ServerOptions options = ToServer();
  options.address = "127.0.0.1:1";
  StatusOr<MapClient> client = MapClient::Create(options);
  ASSERT_THAT(client, IsOk());
  EXPECT_THAT(client->GetSnapshot("floor"), StatusIs(StatusCode::kUnavailable, "127.0.0.1:1"));
}

TEST_F(MapClientTest, FilesOfCertificatesMustBeThere) {
  ServerOptions options = ToServer();
  options.development_plain_text = false;
  options.tls_ca = options.tls_cert = options.tls_key = folder_.File("no.pem");
  EXPECT_THAT(MapClient::Create(options), StatusIs(StatusCode::kNotFound, "no.pem"));
}

TEST_F(MapClientTest, CodesOfTheServerKeepTheirMeaning) {
  MapClient client = Client();
  // Those of gRPC, by number.
  const std::vector<std::pair<int, StatusCode>> codes = {{3, StatusCode::kInvalidArgument},
                                                         {5, StatusCode::kNotFound},
                                                         {7, StatusCode::kPermissionDenied},
                                                         {8, StatusCode::kResourceExhausted},
                                                         {11, StatusCode::kOutOfRange},
                                                         {14, StatusCode::kUnavailable},
                                                         {15, StatusCode::kDataLoss},
                                                         {16, StatusCode::kUnauthenticated},
                                                         {1, StatusCode::kUnavailable}};
  for (const auto& [code, expected] : codes) {
    server_.FailNext(1, code);
    EXPECT_THAT(client.GetSnapshot("floor"), StatusIs(expected, "told to fail")) << code;
  }
}

TEST_F(MapClientTest, AStopEndsACall) {
  std::stop_source stop;
  MapClient client = Client(stop.get_token());
  const std::jthread stopper([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    stop.request_stop();
  });
  EXPECT_THAT(client.WatchSnapshots("floor", [](const SnapshotInfo&) {}),
              StatusIs(StatusCode::kCancelled, "server"));
}

TEST_F(MapClientTest, WatchTellsOfEachSnapshotUntilItsDeadline) {
  ServerOptions options = ToServer();
  options.stream_deadline_s = 1.0;
  StatusOr<MapClient> client = MapClient::Create(options);
  ASSERT_THAT(client, IsOk());
  testing::FakeMapServer::Snapshot snapshot;
  snapshot.bytes = "one";
  server_.Publish(snapshot);
  std::set<std::string> told;
  EXPECT_THAT(client->WatchSnapshots("floor",
                                     [&](const SnapshotInfo& info) {
                                       if (told.insert(info.sha256).second && told.size() == 1) {
                                         snapshot.bytes = "two";
                                         server_.Publish(snapshot);
                                       }
                                     }),
              IsOk());
  EXPECT_EQ(told.size(), 2u);
}

}  // namespace
}  // namespace shiftmap::transfer
