// SPDX-License-Identifier: Apache-2.0
#include "mapper/alignment/explain_displacements.h"

#include <algorithm>
#include <utility>

namespace shiftmap {
namespace {

// Displacements of one frame: the first of them is the most likely.
struct DisplacedFrame {
  const Displacement* best = nullptr;
  StayedSets sets = {};
};

bool AreOfOneFrame(const Displacement& x, const Displacement& y, double tolerance_m) {
  for (Eigen::Index row = 0; row + 1 < x.common.size(); row += 2) {
    if ((x.common.segment<2>(row) - y.common.segment<2>(row)).norm() >= tolerance_m) return false;
  }
  return true;
}

std::vector<GroupIndex> StayedGroups(const IndexedVector<LandmarkIndex, GroupIndex>& groups,
                                     const Displacement& displacement) {
  std::vector<GroupIndex> stayed;
  for (const LandmarkIndex i : groups.indices()) {
    if (displacement.clusters[i] == kNotDisplaced) stayed.push_back(groups[i]);
  }
  stayed.erase(std::unique(stayed.begin(), stayed.end()), stayed.end());
  return stayed;
}

}  // namespace

Explanations ExplainDisplacements(const IndexedVector<LandmarkIndex, GroupIndex>& groups,
                                  const std::vector<Displacement>& displacements,
                                  double same_frame_m) {
  std::vector<DisplacedFrame> frames;
  for (const Displacement& displacement : displacements) {
    auto frame = std::find_if(frames.begin(), frames.end(), [&](const DisplacedFrame& known) {
      return AreOfOneFrame(displacement, *known.best, same_frame_m);
    });
    if (frame == frames.end()) frame = frames.insert(frames.end(), DisplacedFrame{&displacement});
    frame->sets[StayedGroups(groups, displacement)] += displacement.probability;
  }
  std::vector<Explanation> explanations;
  for (const DisplacedFrame& frame : frames) {
    explanations.push_back(DescribeFrame(frame.sets, StayedGroups(groups, *frame.best), groups));
  }
  return DescribeFrames(std::move(explanations));
}

}  // namespace shiftmap
