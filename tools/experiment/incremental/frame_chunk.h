// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>

#include "mapper/graph/segment.h"
#include "tools/experiment/incremental/window.h"

namespace shiftmap {

/// A stretch of consecutive frames, eliminated from the first to the last onto the frame behind
/// them, the calibration and the modes. Chunks are linked: what one carries is what the next starts
/// from, so a change in one leaves those before it as they are.
class FrameChunk {
 public:
  /// Frames [first, end) of the window; the one at `end` is there too.
  FrameChunk(int first, int end) : first_(first), end_(end) {}

  int first() const { return first_; }
  int end() const { return end_; }

  /// Takes in the frame behind the chunk; Eliminate() has to follow.
  void Extend() { ++end_; }

  /// Counts frames from another one on: of a window whose first `frames` were dropped.
  void Shift(int frames) {
    first_ -= frames;
    end_ -= frames;
  }

  /// Linearizes and eliminates the frames. False if their poses are not determined.
  /// @param before  Carried to the chunk's first frame.
  bool Eliminate(const Window& window, const CarriedSystem& before);

  /// Over the frame at end(), without what is seen from it.
  const CarriedSystem& carried() const { return carried_; }

  /// Sets the steps of the chunk's frames, given those of all that it carries.
  void BackSubstitute(const Eigen::VectorXd& steps, Window* window) const;

 private:
  int first_;
  int end_;
  std::optional<SegmentFactor> segment_;  // Of the last Eliminate().
  CarriedSystem carried_;
};

}  // namespace shiftmap
