// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <csignal>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "mapstore/map/evidence.h"
#include "proto/map_server.grpc.pb.h"
#include "tests/scenario/background_command.h"
#include "tests/scenario/command.h"
#include "tests/scenario/world.h"
#include "tests/support/temp_dir.h"

namespace shiftmap::testing {

/// shiftmap-server, running on a free port.
class ServerProcess {
 public:
  /// @param arguments  Beside --listen.
  explicit ServerProcess(const Arguments& arguments);

  const std::string& address() const { return address_; }
  std::string metrics_address() const { return Field("metrics"); }
  std::string Log() const { return command_.Errors(); }

  /// Waits until the log has a text; false if it does not come.
  bool Logs(const std::string& text) const;

  void Signal(int signal) const { kill(command_.pid(), signal); }

  /// Bounds the size of the files that it writes, as a full disk does. [byte]
  void LimitFiles(rlim_t size) const {
    const rlimit limit = {size, RLIM_INFINITY};
    prlimit(command_.pid(), RLIMIT_FSIZE, &limit, nullptr);
  }

  /// As BackgroundCommand::End.
  int End(int signal) { return command_.End(signal); }

 private:
  std::string Field(const std::string& name) const;

  BackgroundCommand command_;
  std::string address_;
};

/// A store with a published map and a report of a shift on it, as a site has them, made once; and a
/// folder with certificates.
class ServerTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite();
  static void TearDownTestSuite();

  ServerTest();

  Arguments PlainText() const;
  Arguments Tls() const;

  /// A client with the certificate of a name of an authority's folder; empty: without any.
  std::unique_ptr<proto::MapServer::Stub> Client(const ServerProcess& server,
                                                 const std::string& name,
                                                 const std::string& authority = {}) const;
  static std::unique_ptr<proto::MapServer::Stub> PlainClient(const ServerProcess& server);

  /// The shift's report with another UUID.
  static proto::SubmitReportRequest AnotherReport();

  static std::string LogPath() { return world_->Log(2); }
  static std::string LogBytes() { return ReadFile(LogPath()); }

  /// The vehicle that drove the shift.
  static std::string Vehicle() { return report_->vehicle; }

  static inline World* world_ = nullptr;
  static inline TempDir* certificates_ = nullptr;
  static inline ShiftReport* report_ = nullptr;

  TempDir dir_;
  std::string store_ = dir_.File("maps.db");
  std::string logs_ = dir_.File("logs");
};

/// Runs tools/certificates.sh. @param environment  `NAME=value`.
void MakeCertificate(const Arguments& arguments, const std::string& environment = "");

/// What FetchSnapshot gives: the status, what it is, and its bytes.
struct Fetched {
  grpc::Status status;
  proto::FetchSnapshotResponse head;
  std::string bytes;
};
Fetched Fetch(proto::MapServer::Stub& client, const proto::FetchSnapshotRequest& request);
Fetched Fetch(proto::MapServer::Stub& client, const std::string& area);

/// Uploads a part of a log. @param count  Bytes that are sent from the offset on.
grpc::Status Upload(proto::MapServer::Stub& client,
                    const std::string& log,
                    std::size_t offset,
                    std::size_t count,
                    proto::UploadState* state,
                    const std::string& sha256 = {});

}  // namespace shiftmap::testing
