// SPDX-License-Identifier: Apache-2.0
#include "localizer/live/connection.h"

#include <sys/socket.h>

#include <array>
#include <cerrno>

namespace shiftmap::live {
namespace {

// Few enough that no client keeps the others waiting for long.
constexpr std::size_t kReadBytes = std::size_t{16} << 10;

bool Wanted(const Event& event, const Subscribe& subscription) {
  if (std::holds_alternative<PoseEvent>(event)) return subscription.poses;
  if (std::holds_alternative<StateEvent>(event)) return subscription.states;
  if (std::holds_alternative<DownloadMap>(event)) return subscription.map_downloads;
  return std::holds_alternative<Decision>(event) && subscription.decisions;
}

bool TryLater() { return errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR; }

}  // namespace

void Connection::Read() {
  std::array<char, kReadBytes> bytes;
  const ssize_t count = recv(fd_.get(), bytes.data(), bytes.size(), 0);
  if (count > 0) {
    reader_.Append(std::string_view(bytes.data(), static_cast<std::size_t>(count)));
  } else if (count == 0) {
    ended_ = true;
  } else if (!TryLater()) {
    broken_ = true;
  }
}

StatusOr<std::optional<std::string>> Connection::NextMessage(Clock::time_point now) {
  auto message = reader_.Next();
  if (!message.ok()) ended_ = true;
  has_more_ = message.ok() && message->has_value();
  if (has_more_) {
    activity_.last = now;
    activity_.has_spoken = true;
    activity_.half_since.reset();
  } else if (reader_.pending() == 0) {
    activity_.half_since.reset();
  } else if (!activity_.half_since) {
    activity_.half_since = now;
  }
  return message;
}

void Connection::SendEvents(const Event& event, std::string_view frame) {
  if (Wanted(event, subscription_)) output_.PushEvent(frame);
}

void Connection::SendReply(std::string_view frame) {
  if (!output_.PushReply(frame)) broken_ = true;
}

void Connection::Flush() {
  while (wants_write()) {
    const std::string_view bytes = output_.Front();
    const ssize_t count = send(fd_.get(), bytes.data(), bytes.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
    if (count < 0) {
      if (!TryLater()) broken_ = true;
      return;
    }
    output_.Sent(static_cast<std::size_t>(count));
  }
}

std::int64_t Connection::TakeDropped() {
  const std::int64_t lost = output_.dropped() - told_dropped_;
  told_dropped_ = output_.dropped();
  return lost;
}

}  // namespace shiftmap::live
