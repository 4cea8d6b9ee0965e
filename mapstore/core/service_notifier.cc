// SPDX-License-Identifier: Apache-2.0
#include "mapstore/core/service_notifier.h"

#include <sys/socket.h>
#include <sys/un.h>

#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <cstring>

namespace shiftmap {
namespace {

constexpr std::chrono::milliseconds kStartingSignEvery(1000);

std::string Variable(const char* name) {
  const char* value = std::getenv(name);
  return value == nullptr ? std::string() : std::string(value);
}

// The watchdog's interval, if it is set and for this process.
std::optional<std::chrono::milliseconds> WatchdogInterval() {
  const std::string pid = Variable("WATCHDOG_PID");
  if (!pid.empty() && pid != std::to_string(getpid())) return std::nullopt;
  const std::chrono::microseconds interval(
      std::strtoll(Variable("WATCHDOG_USEC").c_str(), nullptr, 10));
  if (interval.count() <= 0) return std::nullopt;
  constexpr std::chrono::milliseconds kShortest(1);
  return std::max(kShortest, std::chrono::duration_cast<std::chrono::milliseconds>(interval / 2));
}

}  // namespace

ServiceNotifier::ServiceNotifier() : address_(Variable("NOTIFY_SOCKET")) {
  if (address_.empty() || address_.size() >= sizeof(sockaddr_un::sun_path)) {
    address_.clear();
    return;
  }
  socket_ = OwnedFd(socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  interval_ = WatchdogInterval();
}

void ServiceNotifier::Send(std::string_view lines) {
  if (address_.empty()) return;
  sockaddr_un to{};
  to.sun_family = AF_UNIX;
  std::memcpy(to.sun_path, address_.data(), address_.size());
  // '@' stands for the null byte of an abstract address, whose length counts.
  if (to.sun_path[0] == '@') to.sun_path[0] = '\0';
  const auto length = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + address_.size());
  sendto(socket_.get(),
         lines.data(),
         lines.size(),
         MSG_NOSIGNAL,
         reinterpret_cast<const sockaddr*>(&to),
         length);
}

void ServiceNotifier::Alive() {
  if (!interval_) return;
  const Clock::time_point now = Clock::now();
  if (last_sign_ && now - *last_sign_ < *interval_ / 2) return;
  last_sign_ = now;
  Send("WATCHDOG=1");
}

void ServiceNotifier::StillStarting() {
  const Clock::time_point now = Clock::now();
  if (last_sign_ && now - *last_sign_ < kStartingSignEvery) return;
  last_sign_ = now;
  Send("EXTEND_TIMEOUT_USEC=10000000\nSTATUS=taking up an interrupted shift");
}

}  // namespace shiftmap
