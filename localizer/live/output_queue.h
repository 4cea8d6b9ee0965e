// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <string>
#include <string_view>

namespace shiftmap::live {

/// Bytes on their way to one client, bounded: a client that does not read loses the oldest events,
/// and one that asks without ever reading the answers is let go.
class OutputQueue {
 public:
  /// @param max_bytes  Held at most.
  explicit OutputQueue(std::size_t max_bytes) : max_bytes_(max_bytes) {}

  /// Adds a message that may be lost, if need be by dropping older ones of its kind.
  void PushEvent(std::string_view frame);

  /// Adds a message that must not be lost. Returns false if there is no room even without events.
  bool PushReply(std::string_view frame);

  bool empty() const { return frames_.empty(); }

  /// What is to be sent next; empty if nothing.
  std::string_view Front() const;

  /// Takes the first bytes of Front() out.
  void Sent(std::size_t bytes);

  std::size_t bytes() const { return bytes_; }
  std::int64_t dropped() const { return dropped_; }

 private:
  struct Frame {
    std::string bytes;
    bool is_event = false;
  };

  // Drops old events until `bytes` more fit; false if they do not.
  bool MakeRoom(std::size_t bytes);
  void Push(std::string_view frame, bool is_event);

  std::size_t max_bytes_;
  std::deque<Frame> frames_;
  std::size_t sent_ = 0;  // Of the first frame.
  std::size_t bytes_ = 0;
  std::int64_t dropped_ = 0;
};

}  // namespace shiftmap::live
