// SPDX-License-Identifier: Apache-2.0
//
// The map server through its binary.
#include <gmock/gmock.h>
#include <grpcpp/generic/generic_stub.h>

#include <array>
#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <mutex>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>
#include <thread>

#include "mapstore/map/sha256.h"
#include "mapstore/map_store.h"
#include "tests/scenario/server_fixture.h"
#include "tests/support/status_matchers.h"

namespace shiftmap::testing {
namespace {

using ::testing::HasSubstr;

std::string Sha256Of(const std::string& bytes) {
  Sha256 hash;
  hash.Update(bytes);
  return hash.HexDigest();
}

grpc::Status Submit(proto::MapServer::Stub& client,
                    const proto::SubmitReportRequest& request,
                    proto::SubmitReportResponse* response = nullptr) {
  proto::SubmitReportResponse ignored;
  grpc::ClientContext context;
  return client.SubmitReport(&context, request, response != nullptr ? response : &ignored);
}

std::string RunShell(const std::string& line) {
  std::string text;
  FILE* const pipe = popen(line.c_str(), "r");
  std::array<char, 4096> piece = {};
  for (std::size_t got = 0; (got = fread(piece.data(), 1, piece.size(), pipe)) > 0;) {
    text.append(piece.data(), got);
  }
  pclose(pipe);
  return text;
}

// A call by its name and the bytes of its message; the bytes of the answer.
std::string CallRaw(const ServerProcess& server,
                    const std::string& name,
                    const std::string& bytes) {
  grpc::GenericStub generic(
      grpc::CreateChannel(server.address(), grpc::InsecureChannelCredentials()));
  grpc::CompletionQueue queue;
  const auto next = [&] {
    void* tag = nullptr;
    bool ok = false;
    return queue.Next(&tag, &ok) && ok;
  };
  grpc::ClientContext context;
  const auto stream = generic.PrepareCall(&context, name, &queue);
  stream->StartCall(nullptr);
  const grpc::Slice slice(bytes);
  std::string answer;
  if (!next()) return "not connected";
  stream->WriteLast(grpc::ByteBuffer(&slice, 1), grpc::WriteOptions(), nullptr);
  grpc::ByteBuffer buffer;
  if (next()) stream->Read(&buffer, nullptr);
  if (next()) {
    grpc::Slice whole;
    if (buffer.DumpToSingleSlice(&whole).ok()) answer.assign(whole.begin(), whole.end());
  }
  context.TryCancel();
  grpc::Status status;
  stream->Finish(&status, nullptr);
  next();
  return answer.empty() ? status.error_message() : answer;
}

std::set<std::string> StoredReports(const std::string& path) {
  StatusOr<MapStore> store = MapStore::Open(path, MapStore::Access::kReadOnly);
  const StatusOr<std::vector<ReportSummary>> reports = store->Reports("floor");
  std::set<std::string> uuids;
  for (const ReportSummary& report : *reports) uuids.insert(report.uuid);
  return uuids;
}

TEST_F(ServerTest, AreasVersionsAndProbabilitiesAreThoseOfTheStore) {
  const ServerProcess server(PlainText());
  const auto client = PlainClient(server);
  grpc::ClientContext areas_context;
  proto::ListAreasResponse areas;
  ASSERT_TRUE(client->ListAreas(&areas_context, {}, &areas).ok());
  ASSERT_EQ(areas.area_size(), 1);
  EXPECT_EQ(areas.area(0).area(), "floor");
  EXPECT_EQ(areas.area(0).published_version(), 1);

  grpc::ClientContext versions_context;
  proto::ListVersionsRequest versions_request;
  versions_request.set_area("floor");
  proto::ListVersionsResponse versions;
  ASSERT_TRUE(client->ListVersions(&versions_context, versions_request, &versions).ok());
  ASSERT_EQ(versions.version_size(), 1);
  EXPECT_TRUE(versions.version(0).published());

  StatusOr<MapStore> store = MapStore::Open(store_, MapStore::Access::kReadOnly);
  const Stamp at = report_->end;
  const StatusOr<MapSnapshot> map = store->LoadAt("floor", std::nullopt, at);
  ASSERT_THAT(map, IsOk());
  grpc::ClientContext context;
  proto::GetModeProbabilitiesRequest request;
  request.set_area("floor");
  request.set_at_ns(ToNanoseconds(at));
  proto::GetModeProbabilitiesResponse response;
  ASSERT_TRUE(client->GetModeProbabilities(&context, request, &response).ok());
  ASSERT_EQ(response.landmark_size(), static_cast<int>(map->groups().size()));
  for (int i = 0; i < response.landmark_size(); ++i) {
    const LandmarkGroup& group = map->groups()[static_cast<std::size_t>(i)];
    EXPECT_EQ(response.landmark(i).signature(), group.signature.text());
    ASSERT_EQ(response.landmark(i).mode_size(), group.probabilities.size());
    for (int k = 0; k < response.landmark(i).mode_size(); ++k) {
      EXPECT_EQ(response.landmark(i).mode(k).probability(), group.probabilities[k]);
    }
  }
}

TEST_F(ServerTest, ASnapshotIsTheFileInTheFolderAndGoesOnWhereItWasCut) {
  const ServerProcess server(PlainText());
  const auto client = PlainClient(server);
  const Fetched whole = Fetch(*client, "floor");
  ASSERT_TRUE(whole.status.ok()) << whole.status.error_message();
  const std::string sha256 = whole.head.snapshot().sha256();
  EXPECT_EQ(Sha256Of(whole.bytes), sha256);
  EXPECT_EQ(ReadFile(store_ + ".snapshots/" + sha256 + ".db"), whole.bytes);
  const auto index = nlohmann::json::parse(ReadFile(store_ + ".snapshots/floor.json"));
  EXPECT_EQ(index["file"], sha256 + ".db");

  proto::FetchSnapshotRequest request;
  request.set_area("floor");
  request.set_sha256(sha256);
  request.set_offset_bytes(100'001);
  EXPECT_EQ(Fetch(*client, request).bytes, whole.bytes.substr(100'001));
  request.set_offset_bytes(whole.head.snapshot().size_bytes() + 1);
  EXPECT_EQ(Fetch(*client, request).status.error_code(), grpc::StatusCode::OUT_OF_RANGE);
  request.set_sha256(std::string(64, '0'));
  EXPECT_EQ(Fetch(*client, request).status.error_code(), grpc::StatusCode::NOT_FOUND);
  EXPECT_EQ(Fetch(*client, "attic").status.error_code(), grpc::StatusCode::NOT_FOUND);

  proto::FetchSnapshotRequest again;
  again.set_area("floor");
  again.set_have_sha256(sha256);
  const Fetched unchanged = Fetch(*client, again);
  EXPECT_TRUE(unchanged.status.ok());
  EXPECT_TRUE(unchanged.head.not_changed());
  EXPECT_TRUE(unchanged.bytes.empty());
}

TEST_F(ServerTest, AReportCountsOnceAndStandsInTheAuditUnderTheNameOfItsVehicle) {
  const ServerProcess server(Tls());
  const auto client = Client(server, Vehicle());
  const proto::SubmitReportRequest request = AnotherReport();
  proto::SubmitReportResponse first;
  ASSERT_TRUE(Submit(*client, request, &first).ok());
  EXPECT_FALSE(first.duplicate());
  EXPECT_EQ(first.evidence_rows(), request.report().evidence_size());
  proto::SubmitReportResponse second;
  ASSERT_TRUE(Submit(*client, request, &second).ok());
  EXPECT_TRUE(second.duplicate());
  EXPECT_EQ(StoredReports(store_), std::set<std::string>{request.report().uuid()});
  StatusOr<MapStore> store = MapStore::Open(store_, MapStore::Access::kReadOnly);
  EXPECT_EQ(store->AuditLog()->back().subject, request.report().uuid() + " by " + Vehicle());
}

TEST_F(ServerTest, AReportOfAClockThatWasNotSetIsRefusedAndLogged) {
  ServerProcess server(PlainText());
  proto::SubmitReportRequest request = AnotherReport();
  request.mutable_report()->set_begin_ns(0);
  const grpc::Status refused = Submit(*PlainClient(server), request);
  EXPECT_EQ(refused.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_THAT(refused.error_message(), HasSubstr("begins at 1970-01-01 00:00:00 UTC"));
  EXPECT_TRUE(server.Logs("begins at 1970-01-01 00:00:00 UTC")) << server.Log();
  EXPECT_EQ(StoredReports(store_).count(request.report().uuid()), 0u);
}

TEST_F(ServerTest, WhoMayNotIsRefusedAndLogged) {
  const std::string ca = certificates_->File("ca");
  const std::string foreign = dir_.File("foreign");
  MakeCertificate({"init", foreign});
  MakeCertificate({"client", foreign, "vehicle", Vehicle()});
  MakeCertificate({"client", ca, "vehicle", "old"}, "ENDS=20200101000000Z");
  MakeCertificate({"client", ca, "vehicle", "gone"});
  MakeCertificate({"revoke", ca, "gone"});
  const ServerProcess server(Tls());
  const auto code = [&](const std::string& name, const std::string& authority = {}) {
    return Fetch(*Client(server, name, authority), "floor").status.error_code();
  };
  EXPECT_EQ(code(Vehicle()), grpc::StatusCode::OK);
  EXPECT_EQ(code(""), grpc::StatusCode::UNAVAILABLE);
  EXPECT_TRUE(server.Logs("peer did not return a certificate"));
  EXPECT_EQ(code(Vehicle(), foreign), grpc::StatusCode::UNAVAILABLE);
  EXPECT_TRUE(server.Logs("certificate verify failed"));
  EXPECT_EQ(code("old"), grpc::StatusCode::UNAVAILABLE);
  EXPECT_EQ(code("gone"), grpc::StatusCode::UNAUTHENTICATED);
  EXPECT_TRUE(server.Logs("client certificate of 'gone': revoked"));

  EXPECT_EQ(Submit(*Client(server, "another"), AnotherReport()).error_code(),
            grpc::StatusCode::PERMISSION_DENIED);
  EXPECT_TRUE(server.Logs("but the certificate is of 'another'"));
  EXPECT_EQ(Submit(*Client(server, "eye"), AnotherReport()).error_code(),
            grpc::StatusCode::PERMISSION_DENIED);
  EXPECT_TRUE(server.Logs("'eye' has the role inspector, which may not call SubmitReport"));
  grpc::ClientContext context;
  proto::GetModeProbabilitiesRequest request;
  request.set_area("floor");
  proto::GetModeProbabilitiesResponse response;
  EXPECT_EQ(
      Client(server, Vehicle())->GetModeProbabilities(&context, request, &response).error_code(),
      grpc::StatusCode::PERMISSION_DENIED);
  EXPECT_TRUE(StoredReports(store_).empty());
  EXPECT_TRUE(Submit(*Client(server, "boss"), AnotherReport()).ok());
}

TEST_F(ServerTest, ACertificateIsRevokedWhileTheServerRuns) {
  const std::string ca = certificates_->File("ca");
  MakeCertificate({"client", ca, "vehicle", "stolen"});
  const ServerProcess server(Tls());
  const auto client = Client(server, "stolen");
  ASSERT_TRUE(Fetch(*client, "floor").status.ok());
  grpc::ClientContext context;
  proto::WatchSnapshotsRequest request;
  request.set_area("floor");
  const auto watch = client->WatchSnapshots(&context, request);
  proto::Snapshot snapshot;
  ASSERT_TRUE(watch->Read(&snapshot));
  MakeCertificate({"renew", ca, "stolen"});  // The client has the older one.
  MakeCertificate({"revoke", ca, "stolen"});
  grpc::StatusCode code = grpc::StatusCode::OK;
  for (int tries = 0; tries < 100 * kSlowdown && code == grpc::StatusCode::OK; ++tries) {
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    code = Fetch(*client, "floor").status.error_code();
  }
  EXPECT_EQ(code, grpc::StatusCode::UNAUTHENTICATED);
  RunForJson("shiftmap-mapper", {"build", "--store", store_, "--area", "floor", LogPath()});
  EXPECT_FALSE(watch->Read(&snapshot));
  EXPECT_EQ(watch->Finish().error_code(), grpc::StatusCode::UNAUTHENTICATED);
}

// A list that nobody renews while the server runs.
TEST_F(ServerTest, ACrlThatIsOutOfDateIsLogged) {
  const std::string crl = dir_.File("crl.pem");
  const std::string config = certificates_->File("ca/ca.cnf");
  RunShell("openssl ca -gencrl -crlsec 3 -config '" + config + "' -out '" + crl + "' 2>&1");
  Arguments arguments = Tls();
  arguments.back() = crl;
  const ServerProcess server(arguments);
  const auto client = Client(server, Vehicle());
  for (int tries = 0; tries < 100 * kSlowdown; ++tries) {
    ASSERT_TRUE(Fetch(*client, "floor").status.ok());
    if (server.Log().find("CRL is out of date") != std::string::npos) return;
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  }
  FAIL() << server.Log();
}

TEST_F(ServerTest, AVersionThatAnotherProcessPublishesIsPushed) {
  const ServerProcess server(PlainText());
  const auto client = PlainClient(server);
  grpc::ClientContext context;
  proto::WatchSnapshotsRequest request;
  request.set_area("floor");
  const auto watch = client->WatchSnapshots(&context, request);
  proto::Snapshot first;
  ASSERT_TRUE(watch->Read(&first));
  EXPECT_EQ(first.version(), 1);
  RunForJson("shiftmap-mapper", {"build", "--store", store_, "--area", "floor", LogPath()});
  proto::Snapshot second;
  ASSERT_TRUE(watch->Read(&second));
  EXPECT_EQ(second.version(), 2);
  EXPECT_EQ(Fetch(*client, "floor").head.snapshot().sha256(), second.sha256());
  // The one before can be gone on with.
  proto::FetchSnapshotRequest old;
  old.set_area("floor");
  old.set_sha256(first.sha256());
  EXPECT_EQ(Sha256Of(Fetch(*client, old).bytes), first.sha256());
  RunForJson("shiftmap-inspect", {"rollback", "--store", store_, "--area", "floor"});
  proto::Snapshot third;
  ASSERT_TRUE(watch->Read(&third));
  EXPECT_EQ(third.version(), 1);
  context.TryCancel();
}

TEST_F(ServerTest, AnUploadGoesOnAfterTheServerWasKilled) {
  const std::string log = LogBytes();
  const std::string sha256 = Sha256Of(log);
  const std::size_t half = log.size() / 2;
  proto::UploadState state;
  {
    ServerProcess server(PlainText());
    ASSERT_TRUE(Upload(*PlainClient(server), log, 0, half, &state).ok());
    EXPECT_EQ(state.stored_bytes(), static_cast<std::int64_t>(half));
    EXPECT_FALSE(state.complete());
    server.End(SIGKILL);
  }
  const ServerProcess server(PlainText());
  const auto client = PlainClient(server);
  EXPECT_EQ(Upload(*client, log, half + 1, log.size(), &state).error_code(),
            grpc::StatusCode::OUT_OF_RANGE);
  grpc::ClientContext context;
  proto::GetUploadRequest request;
  request.set_sha256(sha256);
  ASSERT_TRUE(client->GetUpload(&context, request, &state).ok());
  ASSERT_EQ(state.stored_bytes(), static_cast<std::int64_t>(half));
  ASSERT_TRUE(Upload(*client, log, half, log.size(), &state).ok());
  EXPECT_TRUE(state.complete());
  ASSERT_TRUE(Upload(*client, log, 0, log.size(), &state).ok());
  EXPECT_TRUE(state.complete());
  int files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(logs_ + "/" + Vehicle())) {
    EXPECT_EQ(ReadFile(entry.path()), log);
    ++files;
  }
  EXPECT_EQ(files, 1);
}

TEST_F(ServerTest, ALogThatNamesAnotherVehicleOrHasAnotherHashIsRefusedAndDropped) {
  const std::string log = LogBytes();
  const ServerProcess server(Tls());
  proto::UploadState state;
  EXPECT_EQ(Upload(*Client(server, "another"), log, 0, log.size(), &state).error_code(),
            grpc::StatusCode::PERMISSION_DENIED);
  EXPECT_TRUE(server.Logs("but the certificate is of 'another'"));
  const auto client = Client(server, Vehicle());
  EXPECT_EQ(Upload(*client, log, 0, log.size(), &state, std::string(64, 'a')).error_code(),
            grpc::StatusCode::DATA_LOSS);
  const std::string text = "no log";
  EXPECT_EQ(Upload(*client, text, 0, text.size(), &state).error_code(),
            grpc::StatusCode::INVALID_ARGUMENT);
  for (const auto& entry : std::filesystem::recursive_directory_iterator(logs_)) {
    EXPECT_FALSE(entry.is_regular_file()) << entry.path();
  }
  EXPECT_TRUE(Upload(*client, log, 0, log.size(), &state).ok());
}

TEST_F(ServerTest, NothingAcknowledgedIsLostWhenTheServerIsKilled) {
  std::mutex mutex;
  std::set<std::string> acknowledged;
  for (int kills = 0; kills < 3; ++kills) {
    ServerProcess server(PlainText());
    std::atomic<bool> over = false;
    std::atomic<int> count = 0;
    std::vector<std::thread> vehicles;
    for (int i = 0; i < 4; ++i) {
      vehicles.emplace_back([&] {
        const auto client = PlainClient(server);
        while (!over) {
          const proto::SubmitReportRequest request = AnotherReport();
          if (!Submit(*client, request).ok()) continue;
          ++count;
          const std::lock_guard lock(mutex);
          acknowledged.insert(request.report().uuid());
        }
      });
    }
    while (count < 20) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    server.End(SIGKILL);
    over = true;
    for (std::thread& vehicle : vehicles) vehicle.join();
  }
  ServerProcess server(PlainText());  // Rolls back what was cut.
  EXPECT_EQ(server.End(SIGTERM), 0);
  const std::set<std::string> stored = StoredReports(store_);
  for (const std::string& uuid : acknowledged) EXPECT_TRUE(stored.contains(uuid)) << uuid;
  EXPECT_GE(acknowledged.size(), 60u);
}

TEST_F(ServerTest, AFullDiskRefusesAndLosesNothing) {
  const ServerProcess server(PlainText());
  const auto client = PlainClient(server);
  const proto::SubmitReportRequest first = AnotherReport();
  const proto::SubmitReportRequest second = AnotherReport();
  ASSERT_TRUE(Submit(*client, first).ok());
  const std::string log = LogBytes();
  proto::UploadState state;
  // No file grows beyond this.
  server.LimitFiles(1000);
  const auto refused = [](const grpc::Status& status) {
    return status.error_code() == grpc::StatusCode::RESOURCE_EXHAUSTED ||
           status.error_code() == grpc::StatusCode::UNAVAILABLE;
  };
  EXPECT_TRUE(refused(Submit(*client, second)));
  EXPECT_TRUE(refused(Upload(*client, log, 0, log.size(), &state)));
  server.LimitFiles(RLIM_INFINITY);
  ASSERT_TRUE(Submit(*client, second).ok());
  EXPECT_EQ(StoredReports(store_),
            (std::set<std::string>{first.report().uuid(), second.report().uuid()}));
  grpc::ClientContext context;
  proto::GetUploadRequest request;
  request.set_sha256(Sha256Of(log));
  ASSERT_TRUE(client->GetUpload(&context, request, &state).ok());
  EXPECT_GT(state.stored_bytes(), 0);
  ASSERT_TRUE(
      Upload(*client, log, static_cast<std::size_t>(state.stored_bytes()), log.size(), &state)
          .ok());
  EXPECT_TRUE(state.complete());
  RunForJson("shiftmap-inspect", {"verify", "--store", store_});
}

TEST_F(ServerTest, ItTellsHealthAndMetricsAndDescribesItself) {
  Arguments arguments = PlainText();
  arguments.insert(arguments.end(), {"--metrics-listen", "0"});
  const ServerProcess server(arguments);
  EXPECT_EQ(CallRaw(server, "/grpc.health.v1.Health/Check", ""), "\x08\x01");  // SERVING
  EXPECT_EQ(CallRaw(server, "/grpc.health.v1.Health/Check", "\x0a\x18shiftmap.proto.MapServer"),
            "\x08\x01");
  // list_services
  EXPECT_THAT(CallRaw(server,
                      "/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo",
                      std::string("\x3a\x01*")),
              HasSubstr("shiftmap.proto.MapServer"));
  ASSERT_TRUE(Submit(*PlainClient(server), AnotherReport()).ok());
  const std::string metrics =
      RunShell("python3 -c \"import urllib.request as u; print(u.urlopen('http://" +
               server.metrics_address() + "/metrics', timeout=10).read().decode())\"");
  EXPECT_THAT(metrics, HasSubstr("shiftmap_reports_total{outcome=\"accepted\"} 1"));
  EXPECT_THAT(metrics, HasSubstr("shiftmap_published_version{area=\"floor\"} 1"));
}

TEST_F(ServerTest, WatchesEndWithTheServer) {
  ServerProcess server(PlainText());
  auto client = PlainClient(server);
  {
    grpc::ClientContext context;
    proto::WatchSnapshotsRequest request;
    request.set_area("floor");
    const auto watch = client->WatchSnapshots(&context, request);
    proto::Snapshot snapshot;
    ASSERT_TRUE(watch->Read(&snapshot));
    server.Signal(SIGTERM);
    EXPECT_FALSE(watch->Read(&snapshot));
    EXPECT_EQ(watch->Finish().error_code(), grpc::StatusCode::UNAVAILABLE);
  }
  // A connection that nobody looks at would take the whole grace.
  client.reset();
  EXPECT_EQ(server.End(0), 0);
}

TEST_F(ServerTest, ARenewedCertificateIsTakenWhileTheServerRuns) {
  const ServerProcess server(Tls());
  const auto serial = [&] {
    return RunShell("openssl s_client -connect " + server.address() +
                    " </dev/null 2>/dev/null | openssl x509 -noout -serial");
  };
  const std::string before = serial();
  EXPECT_THAT(before, HasSubstr("serial="));
  MakeCertificate({"renew", certificates_->File("ca"), "localhost"});
  std::string after = before;
  for (int tries = 0; tries < 100 * kSlowdown && after == before; ++tries) {
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    after = serial();
  }
  EXPECT_NE(after, before);
  EXPECT_TRUE(Fetch(*Client(server, Vehicle()), "floor").status.ok());
}

// Half a copy, or a certificate that came before its key.
TEST_F(ServerTest, FilesThatDoNotFitLeaveTheCertificateThatTheServerHas) {
  const std::string certificate = dir_.File("server.pem");
  const std::string key = dir_.File("server.key");
  const std::string authority = dir_.File("authority.pem");
  const std::string ca = certificates_->File("ca");
  RunShell("cp '" + ca + "/localhost.pem' '" + certificate + "'; cp '" + ca + "/localhost.key' '" +
           key + "'; cp '" + ca + "/ca.pem' '" + authority + "'");
  Arguments arguments = Tls();
  for (std::string& argument : arguments) {
    if (argument == ca + "/localhost.pem") argument = certificate;
    if (argument == ca + "/localhost.key") argument = key;
    if (argument == ca + "/ca.pem") argument = authority;
  }
  const ServerProcess server(arguments);
  const auto spoil = [&](const std::string& command, const std::string& message) {
    RunShell(command);
    EXPECT_TRUE(server.Logs(message)) << server.Log();
    // gRPC looks every two seconds.
    std::this_thread::sleep_for(std::chrono::seconds(3));
    EXPECT_TRUE(Fetch(*Client(server, Vehicle()), "floor").status.ok()) << command;
  };
  spoil("truncate --size=200 '" + certificate + "'", "expected a certificate in PEM");
  spoil("rm '" + authority + "'; cp '" + ca + "/localhost.pem' '" + certificate + "'",
        "client CA '" + authority + "'");
  spoil("cp '" + ca + "/ca.pem' '" + authority + "'; openssl genpkey -algorithm RSA -out '" + key +
            "' 2>/dev/null",
        "does not belong to certificate");
}

TEST_F(ServerTest, ACallerIsHeldToItsRateAndItsStreams) {
  Arguments arguments = Tls();
  arguments.insert(arguments.end(), {"--calls-per-s", "1", "--max-streams-per-client", "1"});
  const ServerProcess server(arguments);
  const auto client = Client(server, Vehicle());
  grpc::ClientContext watch_context;
  proto::WatchSnapshotsRequest request;
  request.set_area("floor");
  const auto watch = client->WatchSnapshots(&watch_context, request);
  proto::Snapshot snapshot;
  ASSERT_TRUE(watch->Read(&snapshot));
  grpc::ClientContext second_context;
  const auto second = client->WatchSnapshots(&second_context, request);
  EXPECT_FALSE(second->Read(&snapshot));
  EXPECT_EQ(second->Finish().error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
  grpc::StatusCode code = grpc::StatusCode::OK;
  for (int i = 0; i < 10 && code == grpc::StatusCode::OK; ++i) {
    code = Fetch(*client, "floor").status.error_code();
  }
  EXPECT_EQ(code, grpc::StatusCode::RESOURCE_EXHAUSTED);
  watch_context.TryCancel();
}

TEST(ServerUsageTest, PlainTextStaysOnTheMachine) {
  const CommandResult result = RunCommand(
      "shiftmap-server", {"--store", "a.db", "--listen", "0.0.0.0:0", "--development-plain-text"});
  EXPECT_EQ(result.exit_code, 2);
  EXPECT_NE(result.err.find("is no loopback address"), std::string::npos) << result.err;
  EXPECT_EQ(RunCommand("shiftmap-server", {"--store", "a.db", "--listen", "127.0.0.1:0"}).exit_code,
            2);
}

// What somebody else writes with the installed .proto files alone.
TEST_F(ServerTest, ThePythonExampleFetchesAMapAndSubmitsAReport) {
  if (std::system("/usr/bin/python3 -c 'import grpc' 2>/dev/null") != 0) {
    GTEST_SKIP() << "python3-grpcio is not installed";
  }
  const ServerProcess server(Tls());
  const std::string ca = certificates_->File("ca");
  const std::string out = RunShell(
      "cd '" + dir_.File("") +
      "' && protoc -I " SHIFTMAP_SOURCE_DIR
      " --python_out=. --grpc_out=. --plugin=protoc-gen-grpc=$(command -v grpc_python_plugin) "
      "proto/map_server.proto proto/shift_report.proto && PYTHONPATH=. timeout 60 "
      "/usr/bin/python3 " SHIFTMAP_SOURCE_DIR "/mapstore/server/example/fetch_and_submit.py " +
      server.address() + " floor map.db '" + world_->File("shift.report") + "' '" + ca +
      "/ca.pem' '" + ca + "/" + Vehicle() + ".pem' '" + ca + "/" + Vehicle() + ".key' 2>&1");
  EXPECT_NE(out.find("duplicate: False"), std::string::npos) << out;
  RunForJson("shiftmap-inspect", {"show", "--store", dir_.File("map.db"), "--area", "floor"});
  EXPECT_EQ(StoredReports(store_), std::set<std::string>{report_->uuid});
}

TEST_F(ServerTest, LogsNothingButJsonWhateverComes) {
  ServerProcess server(PlainText());
  // A string field that is no UTF-8, a length beyond the end, and no message at all.
  for (const std::string bytes : {"\x0a\x02\xff\xfe", "\x0a\x7f\x41", "\xff\xff\xff"}) {
    for (const std::string name : {"GetSnapshot", "GetUpload", "SubmitReport"}) {
      CallRaw(server, "/shiftmap.proto.MapServer/" + name, bytes);
    }
  }
  EXPECT_EQ(server.End(SIGTERM), 0);
  std::istringstream lines(server.Log());
  int count = 0;
  for (std::string line; std::getline(lines, line); ++count) {
    EXPECT_TRUE(nlohmann::json::accept(line)) << line;
  }
  EXPECT_GT(count, 0);
}

}  // namespace
}  // namespace shiftmap::testing
