// SPDX-License-Identifier: Apache-2.0
#include "tests/scenario/server_fixture.h"

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <thread>

#include "mapstore/codec/shift_report.h"
#include "mapstore/map/sha256.h"
#include "proto/core/check.h"

namespace shiftmap::testing {
namespace {

Arguments WithAddress(Arguments arguments) {
  arguments.insert(arguments.end(), {"--listen", "127.0.0.1:0", "--poll-s", "0.1"});
  return arguments;
}

std::string Sha256Of(const std::string& bytes) {
  Sha256 hash;
  hash.Update(bytes);
  return hash.HexDigest();
}

}  // namespace

ServerProcess::ServerProcess(const Arguments& arguments)
    : command_("shiftmap-server", WithAddress(arguments)) {
  SHIFTMAP_CHECK(Logs("\"listening\""), "the server does not start: {}", Log());
  address_ = Field("address");
}

bool ServerProcess::Logs(const std::string& text) const {
  for (int tries = 0; tries < 1000 * kSlowdown; ++tries) {
    if (Log().find(text) != std::string::npos) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  return false;
}

std::string ServerProcess::Field(const std::string& name) const {
  const std::string log = Log();
  const std::string key = "\"" + name + "\":\"";
  const std::size_t at = log.find(key, log.find("\"listening\""));
  SHIFTMAP_CHECK(at != std::string::npos, "no {} in {}", name, log);
  const std::size_t begin = at + key.size();
  return log.substr(begin, log.find('"', begin) - begin);
}

void MakeCertificate(const Arguments& arguments, const std::string& environment) {
  std::string line = environment + " " + SHIFTMAP_CERTIFICATES;
  for (const std::string& argument : arguments) line += " '" + argument + "'";
  line += " >/dev/null 2>&1";
  SHIFTMAP_CHECK(std::system(line.c_str()) == 0, "{}", line);
}

void ServerTest::SetUpTestSuite() {
  world_ = new World({"--shifts",
                      "3",
                      "--groups",
                      "10",
                      "--modes",
                      "2",
                      "--size-m",
                      "20",
                      "--duration-s",
                      "60",
                      "--seed",
                      "3"});
  const std::string store = world_->File("maps.db");
  RunForJson("shiftmap-mapper", world_->BuildOf("maps.db", {0, 1}));
  RunForJson("shiftmap-localizer",
             {"run",
              "--store",
              store,
              "--area",
              "floor",
              "--initial-pose",
              "auto",
              "--report",
              world_->File("shift.report"),
              LogPath()});
  report_ = new ShiftReport(*ReadShiftReport(world_->File("shift.report")));
  certificates_ = new TempDir();
  const std::string ca = certificates_->File("ca");
  MakeCertificate({"init", ca});
  MakeCertificate({"server", ca, "localhost", "127.0.0.1"});
  MakeCertificate({"client", ca, "vehicle", Vehicle()});
  MakeCertificate({"client", ca, "vehicle", "another"});
  MakeCertificate({"client", ca, "inspector", "eye"});
  MakeCertificate({"client", ca, "operator", "boss"});
}

void ServerTest::TearDownTestSuite() {
  delete world_;
  delete certificates_;
  delete report_;
}

ServerTest::ServerTest() { std::filesystem::copy_file(world_->File("maps.db"), store_); }

Arguments ServerTest::PlainText() const {
  return {"--store",
          store_,
          "--logs",
          logs_,
          "--keep-free-mib",
          "0",
          "--development-plain-text",
          "--calls-per-s",
          "100000"};
}

Arguments ServerTest::Tls() const {
  const std::string ca = certificates_->File("ca");
  return {"--store",
          store_,
          "--logs",
          logs_,
          "--keep-free-mib",
          "0",
          "--tls-cert",
          ca + "/localhost.pem",
          "--tls-key",
          ca + "/localhost.key",
          "--client-ca",
          ca + "/ca.pem",
          "--crl",
          ca + "/crl.pem"};
}

std::unique_ptr<proto::MapServer::Stub> ServerTest::Client(const ServerProcess& server,
                                                           const std::string& name,
                                                           const std::string& authority) const {
  const std::string ca = certificates_->File("ca");
  const std::string from = authority.empty() ? ca : authority;
  grpc::SslCredentialsOptions options;
  options.pem_root_certs = ReadFile(ca + "/ca.pem");
  if (!name.empty()) {
    options.pem_private_key = ReadFile(from + "/" + name + ".key");
    options.pem_cert_chain = ReadFile(from + "/" + name + ".pem");
  }
  grpc::ChannelArguments arguments;
  // No connection of another client.
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
  return proto::MapServer::NewStub(
      grpc::CreateCustomChannel(server.address(), grpc::SslCredentials(options), arguments));
}

std::unique_ptr<proto::MapServer::Stub> ServerTest::PlainClient(const ServerProcess& server) {
  return proto::MapServer::NewStub(
      grpc::CreateChannel(server.address(), grpc::InsecureChannelCredentials()));
}

proto::SubmitReportRequest ServerTest::AnotherReport() {
  ShiftReport report = *report_;
  report.uuid = RandomUuid();
  proto::SubmitReportRequest request;
  SHIFTMAP_CHECK(request.mutable_report()->ParseFromString(EncodeShiftReport(report)), "report");
  return request;
}

Fetched Fetch(proto::MapServer::Stub& client, const proto::FetchSnapshotRequest& request) {
  Fetched fetched;
  grpc::ClientContext context;
  const auto reader = client.FetchSnapshot(&context, request);
  if (reader->Read(&fetched.head)) {
    for (proto::FetchSnapshotResponse part; reader->Read(&part);) fetched.bytes += part.data();
  }
  fetched.status = reader->Finish();
  return fetched;
}

Fetched Fetch(proto::MapServer::Stub& client, const std::string& area) {
  proto::FetchSnapshotRequest request;
  request.set_area(area);
  return Fetch(client, request);
}

grpc::Status Upload(proto::MapServer::Stub& client,
                    const std::string& log,
                    std::size_t offset,
                    std::size_t count,
                    proto::UploadState* state,
                    const std::string& sha256) {
  grpc::ClientContext context;
  const auto writer = client.UploadLog(&context, state);
  proto::UploadLogRequest message;
  message.mutable_header()->set_sha256(sha256.empty() ? Sha256Of(log) : sha256);
  message.mutable_header()->set_size_bytes(static_cast<std::int64_t>(log.size()));
  message.mutable_header()->set_offset_bytes(static_cast<std::int64_t>(offset));
  bool goes_on = writer->Write(message);
  const std::size_t end = std::min(log.size(), offset + count);
  while (goes_on && offset < end) {
    const std::size_t size = std::min<std::size_t>(1000, end - offset);
    message.set_data(log.substr(offset, size));
    offset += size;
    goes_on = writer->Write(message);
  }
  writer->WritesDone();
  return writer->Finish();
}

}  // namespace shiftmap::testing
