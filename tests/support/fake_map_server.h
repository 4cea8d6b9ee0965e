// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

namespace shiftmap::testing {

/// A map server without a store, in this process, on a port of 127.0.0.1 in plain text. It can be
/// told to fail. Threads: any.
class FakeMapServer {
 public:
  FakeMapServer();
  ~FakeMapServer();
  FakeMapServer(const FakeMapServer&) = delete;
  FakeMapServer& operator=(const FakeMapServer&) = delete;

  std::string address() const;
  int port() const;

  /// The newest snapshot of area `floor`; who watches is told.
  struct Snapshot {
    std::int64_t version = 1;
    std::string content_hash;
    std::int64_t ledger_sequence = 0;
    std::string bytes;
    std::string key_sha256;  ///< Of its signature; empty: not signed.
    std::string signature;
  };
  void Publish(const Snapshot& snapshot);

  /// Calls until then answer with the code of gRPC, after they did what they should if `late`.
  void FailNext(int calls, int code, bool late = false);

  /// Streams end with UNAVAILABLE after so many bytes; 0: never.
  void CutStreamsAfter(std::int64_t bytes);

  /// How often each report came, by UUID; and the logs that are whole, by SHA-256.
  std::map<std::string, int> reports() const;
  std::map<std::string, std::string> logs() const;

  int calls() const;

  /// A report of this UUID, or a log of this hash, is refused for good.
  void Refuse(const std::string& name);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace shiftmap::testing
