// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "localizer/live/client_places.h"
#include "localizer/live/framing.h"
#include "localizer/live/messages.h"
#include "localizer/live/output_queue.h"
#include "mapstore/core/owned_fd.h"

namespace shiftmap::live {

/// One client: its socket, which never blocks, and what is on the way in and out.
class Connection {
 public:
  using Clock = ClientActivity::Clock;

  Connection(OwnedFd fd, Clock::time_point now)
      : fd_(std::move(fd)), output_(kMaxQueuedBytes), activity_{.last = now} {}

  /// Takes in a bounded share of what the client sent.
  void Read();

  /// The next whole message, or nothing. A stream that cannot be taken apart is not read on.
  /// Errors: as FrameReader::Next.
  StatusOr<std::optional<std::string>> NextMessage(Clock::time_point now);

  /// More whole messages may be there: NextMessage() was not called until there was none.
  bool has_more() const { return has_more_ && !broken_; }

  /// Queues an event for the client, framed: events only if it subscribed to such.
  void SendEvents(const Event& event, std::string_view frame);
  void SendReply(std::string_view frame);

  /// Sends as much as the client takes.
  void Flush();

  void set_subscription(const Subscribe& subscription) { subscription_ = subscription; }
  const Subscribe& subscription() const { return subscription_; }

  /// What decides whether the client may stay.
  ClientActivity activity() const {
    ClientActivity activity = activity_;
    activity.is_owed = wants_write();
    return activity;
  }
  void Keep() { activity_.kept = true; }

  /// True once there is nothing more to do for the client.
  bool Done() const { return broken_ || (ended_ && !has_more_ && output_.empty()); }

  int fd() const { return fd_.get(); }
  bool wants_read() const { return !ended_ && !broken_ && !has_more_; }
  bool wants_write() const { return !output_.empty() && !broken_; }

  /// Events lost since the last call, because the client does not read.
  std::int64_t TakeDropped();

  static constexpr std::size_t kMaxQueuedBytes = std::size_t{256} << 10;

 private:
  OwnedFd fd_;
  FrameReader reader_;
  OutputQueue output_;
  Subscribe subscription_;
  ClientActivity activity_;
  std::int64_t told_dropped_ = 0;
  bool has_more_ = false;
  bool ended_ = false;   // The client says no more.
  bool broken_ = false;  // It hears no more.
};

}  // namespace shiftmap::live
