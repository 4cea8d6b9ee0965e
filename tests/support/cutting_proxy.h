// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <cstdint>
#include <list>
#include <memory>
#include <mutex>
#include <random>
#include <string>
#include <thread>

#include "mapstore/core/owned_fd.h"

namespace shiftmap::testing {

/// How a proxy treats connections. Sizes are drawn log-uniform between 1 and the bound.
struct CutOptions {
  double probability = 0.3;              ///< That a connection is cut.
  std::int64_t longest_bytes = 1 << 20;  ///< Bound of what goes through in the cut direction.
  std::uint64_t seed = 1;
};

/// A bad link: a TCP proxy on 127.0.0.1 that cuts some connections, after a byte drawn at random in
/// either direction, or between a request and its answer.
/// Threads: any. Determinism: the cuts are those of the seed, in the order of connections.
class CuttingProxy {
 public:
  /// @param target_port  On 127.0.0.1.
  CuttingProxy(int target_port, const CutOptions& options);
  ~CuttingProxy();
  CuttingProxy(const CuttingProxy&) = delete;
  CuttingProxy& operator=(const CuttingProxy&) = delete;

  int port() const { return port_; }
  std::string address() const { return "127.0.0.1:" + std::to_string(port_); }

  /// Those that reached the target, and those that were cut: a plan may lie behind the end.
  std::int64_t connections() const { return connections_; }
  std::int64_t cuts() const { return cuts_; }

 private:
  enum class CutKind { kNone, kUp, kDown, kAnswer };
  struct Plan {
    CutKind kind = CutKind::kNone;
    std::int64_t bytes = 0;
  };

  Plan Draw();
  void Accept(const std::stop_token& stop);
  void Carry(const std::stop_token& stop, int client, const Plan& plan);

  int target_port_;
  CutOptions options_;
  std::mt19937_64 random_;
  OwnedFd listener_;
  int port_ = 0;
  std::atomic<std::int64_t> connections_{0};
  std::atomic<std::int64_t> cuts_{0};
  std::mutex mutex_;
  std::list<std::jthread> carriers_;
  std::jthread acceptor_;  // Last: it uses the others.
};

}  // namespace shiftmap::testing
