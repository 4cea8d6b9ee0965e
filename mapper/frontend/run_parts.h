// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <utility>
#include <vector>

#include "mapper/frontend/frame_motions.h"
#include "mapper/frontend/mapping_run.h"
#include "mapstore/geometry/se2.h"

namespace shiftmap {

/// Some key frames [first, last) of a run as a run of its own. A visit that goes on beyond them is
/// one in either part.
/// Precondition: 0 <= first < last <= frames.
MappingRun PartOf(const MappingRun& run, FrameIndex first, FrameIndex last);

/// Parts of a run that are placed by themselves, and its poses by those.
class RunParts {
 public:
  /// Parts that each take about `part_s` [s], none of them across a motion of BrokenMotions().
  RunParts(const MappingRun& run, double part_s, const std::vector<FrameIndex>& broken = {});

  std::size_t size() const { return parts_.size(); }
  const MappingRun& At(std::size_t part) const { return parts_[part]; }

  /// The poses of a part's key frames, or none: it is not placed.
  void Place(std::size_t part, std::vector<Se2> poses) { poses_[part] = std::move(poses); }

  /// The poses of the run's key frames: those of parts that are not placed go on from the others,
  /// or from each other, by odometry.
  IndexedVector<FrameIndex, Se2> Poses(const FrameMotions& motions) const;

 private:
  std::vector<MappingRun> parts_;
  std::vector<std::vector<Se2>> poses_;  // Per part; none of one that is not placed.
};

}  // namespace shiftmap
