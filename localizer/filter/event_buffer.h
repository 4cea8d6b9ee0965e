// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "mapstore/core/stamp.h"
#include "mapstore/run/run.h"

namespace shiftmap {

/// An item that waits for its turn: one of the three, each of which keeps its memory.
struct HeldEvent {
  enum class Kind { kOdometry, kLidar, kScan };

  Stamp stamp;
  Kind kind = Kind::kOdometry;
  OdometrySample sample;
  LidarScan lidar;
  Scan scan;

  /// Gives the item that it is.
  template <typename Visitor>
  auto Visit(const Visitor& visitor) const {
    if (kind == Kind::kOdometry) return visitor(sample);
    return kind == Kind::kLidar ? visitor(lidar) : visitor(scan);
  }
};

/// Puts items that arrive late or out of order back into the order of their stamps.
///
/// An item is due when one that is younger by the bound on the delay is there: what comes within
/// that bound has come by then. Time is that of the stamps alone, so the same items in the same
/// order give the same sequence; items of equal stamps keep the order in which they came.
///
/// A stamp more than a second (or the bound, if larger) after all others could be a clock that
/// jumped, and would make everything after it late. It counts for nothing until the next item
/// comes: if that is older, the item with the jump is dropped; else there was a gap.
///
/// Memory: reuses that of items that went; at most kMaxEvents items of kMaxObservations and
/// kMaxBeams in all, of which the oldest is due when another comes. Threads: none.
class EventBuffer {
 public:
  static constexpr std::size_t kMaxEvents = 1024;
  static constexpr std::size_t kMaxObservations = 50'000;
  static constexpr std::size_t kMaxBeams = 1'000'000;

  /// @param max_delay  > 0: what an item may come later than a younger one.
  explicit EventBuffer(Duration max_delay);

  /// @param event  Not older than the last item that Next() returned.
  void Add(const RunEvent& event);

  /// The next item that is due, or null. Valid until the next call.
  const HeldEvent* Next();

  /// Makes all items due that are held now.
  void Flush();

  /// As Flush(), for a stream that pauses: an item far ahead that nothing followed came after a
  /// gap.
  void FlushPaused();

  std::size_t size() const { return size_; }

  /// Items dropped because their stamps had jumped.
  std::int64_t jumps() const { return jumps_; }

 private:
  void Insert(const RunEvent& event);
  void Put(const OdometrySample& sample, HeldEvent* slot);
  void Put(const LidarScan& scan, HeldEvent* slot);
  void Put(const Scan& scan, HeldEvent* slot);
  void DropReturned();

  Duration max_delay_;
  Duration max_jump_;
  std::vector<HeldEvent> slots_;  // The first size_ by stamp; the others are for reuse.
  std::size_t size_ = 0;
  std::size_t observations_ = 0;       // Of the scans that are held.
  std::size_t beams_ = 0;              // Of the lidar's.
  bool returned_ = false;              // The first one was returned by Next().
  std::optional<Stamp> newest_;        // Of those that were in slots_.
  std::optional<Stamp> flushed_;       // Everything up to it is due.
  std::optional<RunEvent> far_ahead_;  // Waits for the next item.
  std::int64_t jumps_ = 0;
};

}  // namespace shiftmap
