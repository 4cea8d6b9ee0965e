// SPDX-License-Identifier: Apache-2.0
#include "tests/support/cutting_proxy.h"

#include <arpa/inet.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <optional>

#include "proto/core/check.h"

namespace shiftmap::testing {
namespace {

using Clock = std::chrono::steady_clock;

constexpr int kPollMs = 20;

// Of the cuts, those that let a request of the client through and hold the answer back.
constexpr double kAnswerShare = 0.34;

// From where on an answer is held back until the connection is cut: the server can commit.
constexpr std::chrono::milliseconds kTimeToCommit(60);

sockaddr_in Loopback(int port) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<std::uint16_t>(port));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  return address;
}

OwnedFd ConnectTo(int port) {
  OwnedFd fd(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
  const sockaddr_in address = Loopback(port);
  if (connect(fd.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) {
    return OwnedFd();
  }
  const int on = 1;
  setsockopt(fd.get(), IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
  return fd;
}

// A cut link sends no FIN in order: what is on its way is gone.
void Reset(int fd) {
  const linger abort{.l_onoff = 1, .l_linger = 0};
  setsockopt(fd, SOL_SOCKET, SO_LINGER, &abort, sizeof abort);
}

bool SendAll(int fd, const char* bytes, std::size_t count) {
  while (count > 0) {
    const ssize_t sent = send(fd, bytes, count, MSG_NOSIGNAL);
    if (sent <= 0) return false;
    bytes += sent;
    count -= static_cast<std::size_t>(sent);
  }
  return true;
}

}  // namespace

CuttingProxy::CuttingProxy(int target_port, const CutOptions& options)
    : target_port_(target_port),
      options_(options),
      random_(options.seed),
      listener_(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
  sockaddr_in address = Loopback(0);
  socklen_t length = sizeof address;
  auto* const generic = reinterpret_cast<sockaddr*>(&address);
  constexpr int kWaiting = 512;
  SHIFTMAP_CHECK(bind(listener_.get(), generic, length) == 0, "no port");
  SHIFTMAP_CHECK(listen(listener_.get(), kWaiting) == 0, "cannot listen");
  SHIFTMAP_CHECK(getsockname(listener_.get(), generic, &length) == 0, "no name");
  port_ = ntohs(address.sin_port);
  acceptor_ = std::jthread([this](const std::stop_token& stop) { Accept(stop); });
}

CuttingProxy::~CuttingProxy() {
  acceptor_.request_stop();
  acceptor_.join();
  for (std::jthread& carrier : carriers_) carrier.request_stop();
  carriers_.clear();
}

CuttingProxy::Plan CuttingProxy::Draw() {
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  if (uniform(random_) >= options_.probability) return {};
  Plan plan;
  // Short cuts hit handshakes and requests, long ones files.
  plan.bytes = static_cast<std::int64_t>(
      std::exp(uniform(random_) * std::log(static_cast<double>(options_.longest_bytes))));
  if (uniform(random_) < kAnswerShare) {
    plan.kind = CutKind::kAnswer;
    constexpr std::int64_t kRequests = 8192;
    plan.bytes = std::min(plan.bytes, kRequests);
  } else {
    plan.kind = uniform(random_) < 0.5 ? CutKind::kUp : CutKind::kDown;
  }
  return plan;
}

void CuttingProxy::Accept(const std::stop_token& stop) {
  while (!stop.stop_requested()) {
    pollfd waiting{.fd = listener_.get(), .events = POLLIN, .revents = 0};
    if (poll(&waiting, 1, kPollMs) <= 0) continue;
    const int client = accept4(listener_.get(), nullptr, nullptr, SOCK_CLOEXEC);
    if (client < 0) continue;
    const int on = 1;
    setsockopt(client, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    const Plan plan = Draw();
    const std::lock_guard lock(mutex_);
    carriers_.emplace_back([this, client, plan](const std::stop_token& carrier_stop) {
      Carry(carrier_stop, client, plan);
    });
  }
}

void CuttingProxy::Carry(const std::stop_token& stop, int client, const Plan& plan) {
  const OwnedFd up(client);
  const OwnedFd down = ConnectTo(target_port_);
  if (down.get() < 0) return;
  ++connections_;
  std::int64_t came_up = 0;
  std::int64_t came_down = 0;
  std::optional<Clock::time_point> cut_at;
  std::array<char, 16384> bytes;
  while (!stop.stop_requested()) {
    std::array<pollfd, 2> ends{pollfd{.fd = up.get(), .events = POLLIN, .revents = 0},
                               pollfd{.fd = down.get(), .events = POLLIN, .revents = 0}};
    poll(ends.data(), ends.size(), kPollMs);
    bool cut = cut_at && Clock::now() >= *cut_at;
    for (int i = 0; i < 2 && !cut; ++i) {
      if (ends[static_cast<std::size_t>(i)].revents == 0) continue;
      const bool from_client = i == 0;
      std::int64_t& came = from_client ? came_up : came_down;
      const ssize_t count =
          recv(from_client ? up.get() : down.get(), bytes.data(), bytes.size(), 0);
      if (count <= 0) return;
      auto through = static_cast<std::int64_t>(count);
      if (plan.kind == (from_client ? CutKind::kUp : CutKind::kDown)) {
        through = std::min(through, plan.bytes - came);
        cut = came + count >= plan.bytes;
      }
      came += count;
      if (plan.kind == CutKind::kAnswer && from_client && !cut_at && came_up >= plan.bytes) {
        cut_at = Clock::now() + kTimeToCommit;
      }
      if (cut_at && !from_client) continue;  // Held back.
      const int to = from_client ? down.get() : up.get();
      if (!SendAll(to, bytes.data(), static_cast<std::size_t>(through))) return;
    }
    if (!cut) continue;
    ++cuts_;
    Reset(up.get());
    Reset(down.get());
    return;
  }
}

}  // namespace shiftmap::testing
