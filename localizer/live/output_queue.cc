// SPDX-License-Identifier: Apache-2.0
#include "localizer/live/output_queue.h"

#include <algorithm>

namespace shiftmap::live {

bool OutputQueue::MakeRoom(std::size_t bytes) {
  while (bytes_ + bytes > max_bytes_) {
    // A frame that has begun on the wire must be finished.
    const auto first = frames_.begin() + (sent_ > 0 ? 1 : 0);
    const auto oldest =
        std::find_if(first, frames_.end(), [](const Frame& frame) { return frame.is_event; });
    if (oldest == frames_.end()) return false;
    bytes_ -= oldest->bytes.size();
    frames_.erase(oldest);
    ++dropped_;
  }
  return true;
}

void OutputQueue::Push(std::string_view frame, bool is_event) {
  frames_.push_back({std::string(frame), is_event});
  bytes_ += frame.size();
}

void OutputQueue::PushEvent(std::string_view frame) {
  if (MakeRoom(frame.size())) {
    Push(frame, true);
  } else {
    ++dropped_;
  }
}

bool OutputQueue::PushReply(std::string_view frame) {
  if (!MakeRoom(frame.size())) return false;
  Push(frame, false);
  return true;
}

std::string_view OutputQueue::Front() const {
  if (frames_.empty()) return {};
  return std::string_view(frames_.front().bytes).substr(sent_);
}

void OutputQueue::Sent(std::size_t bytes) {
  sent_ += bytes;
  if (sent_ < frames_.front().bytes.size()) return;
  bytes_ -= frames_.front().bytes.size();
  frames_.pop_front();
  sent_ = 0;
}

}  // namespace shiftmap::live
