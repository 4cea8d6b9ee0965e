// SPDX-License-Identifier: Apache-2.0
#include "localizer/filter/event_buffer.h"

#include <algorithm>
#include <chrono>

#include "proto/core/check.h"

namespace shiftmap {
namespace {

constexpr Duration kLeastJump = std::chrono::seconds(1);

}  // namespace

EventBuffer::EventBuffer(Duration max_delay)
    : max_delay_(max_delay), max_jump_(std::max(max_delay, kLeastJump)) {
  SHIFTMAP_CHECK(max_delay > Duration::zero(), "delay {} s", ToSeconds(max_delay));
}

void EventBuffer::Add(const RunEvent& event) {
  DropReturned();
  const Stamp stamp = StampOf(event);
  if (far_ahead_) {
    if (stamp >= StampOf(*far_ahead_) - max_delay_) {
      Insert(*far_ahead_);
    } else {
      ++jumps_;
    }
    far_ahead_.reset();
  }
  if (!newest_ || stamp > *newest_ + max_jump_) {
    far_ahead_ = event;
  } else {
    Insert(event);
  }
}

void EventBuffer::Insert(const RunEvent& event) {
  if (slots_.size() == size_) slots_.emplace_back();
  HeldEvent& slot = slots_[size_];
  slot.stamp = StampOf(event);
  std::visit([&](const auto& item) { Put(item, &slot); }, event);
  const Stamp stamp = slot.stamp;
  newest_ = newest_ ? std::max(*newest_, stamp) : stamp;
  const auto last = slots_.begin() + static_cast<std::ptrdiff_t>(size_);
  const auto place =
      std::upper_bound(slots_.begin(), last, stamp, [](Stamp wanted, const HeldEvent& held) {
        return wanted < held.stamp;
      });
  std::rotate(place, last, last + 1);
  ++size_;
}

void EventBuffer::Put(const OdometrySample& sample, HeldEvent* slot) {
  slot->kind = HeldEvent::Kind::kOdometry;
  slot->sample = sample;
}

void EventBuffer::Put(const LidarScan& scan, HeldEvent* slot) {
  slot->kind = HeldEvent::Kind::kLidar;
  slot->lidar = scan;
  beams_ += scan.ranges_m.size();
}

void EventBuffer::Put(const Scan& scan, HeldEvent* slot) {
  slot->kind = HeldEvent::Kind::kScan;
  slot->scan = scan;
  observations_ += scan.observations.size();
}

const HeldEvent* EventBuffer::Next() {
  DropReturned();
  if (size_ == 0) return nullptr;
  const HeldEvent& oldest = slots_.front();
  const bool due = oldest.stamp <= *newest_ - max_delay_ || size_ > kMaxEvents ||
                   observations_ > kMaxObservations || beams_ > kMaxBeams ||
                   (flushed_ && oldest.stamp <= *flushed_);
  if (!due) return nullptr;
  returned_ = true;
  return &oldest;
}

void EventBuffer::DropReturned() {
  if (!returned_) return;
  returned_ = false;
  const HeldEvent& oldest = slots_.front();
  if (oldest.kind == HeldEvent::Kind::kScan) observations_ -= oldest.scan.observations.size();
  if (oldest.kind == HeldEvent::Kind::kLidar) beams_ -= oldest.lidar.ranges_m.size();
  std::rotate(
      slots_.begin(), slots_.begin() + 1, slots_.begin() + static_cast<std::ptrdiff_t>(size_));
  --size_;
}

void EventBuffer::FlushPaused() {
  DropReturned();
  if (far_ahead_) Insert(*far_ahead_);
  far_ahead_.reset();
  Flush();
}

void EventBuffer::Flush() {
  DropReturned();
  if (far_ahead_) ++jumps_;
  far_ahead_.reset();
  if (newest_) flushed_ = newest_;
}

}  // namespace shiftmap
