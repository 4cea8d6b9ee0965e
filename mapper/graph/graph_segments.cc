// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/graph_segments.h"

#include <algorithm>

namespace shiftmap {
namespace {

constexpr int kSegmentFrames = kSegmentPoses + 1;

// Three for a pose, from its first on.
void AppendPose(int first, std::vector<int>* unknowns) {
  for (int i = 0; i < 3; ++i) unknowns->push_back(first < 0 ? -1 : first + i);
}

}  // namespace

SegmentVariable PoseVariable(const GraphSegment& segment, FrameIndex frame) {
  if (frame == segment.first) return {-1, kSeparatorBefore};
  if (frame == segment.last) return {-1, kSeparatorAfter};
  return {frame - segment.first - 1, -1};
}

GraphSegments::GraphSegments(const Graph& graph) {
  for (const RunIndex run : graph.runs.indices()) AddRun(graph, run);
  first_segment_.push_back(static_cast<int>(segments_.size()));
  first_calibration_ = size_;
  first_mode_ = first_calibration_ + kRunCalibration * graph.runs.end_index().value();
  size_ = first_mode_ + 2 * graph.modes.end_index().value();
  for (GraphSegment& segment : segments_) {
    for (int i = 0; i < kRunCalibration; ++i) {
      segment.boundary.push_back(first_calibration_ + kRunCalibration * segment.run.value() + i);
    }
  }
  for (const ObservationIndex i : graph.observations.indices()) {
    AddObservation(graph.observations[i], i);
  }
}

void GraphSegments::AddRun(const Graph& graph, RunIndex run) {
  const FrameIndex last = graph.runs[run].poses.end_index() - 1;
  const bool fixed = graph.priors.empty() && graph.anchor_run == run;
  first_segment_.push_back(static_cast<int>(segments_.size()));
  const auto next_separator = [this] {
    size_ += 3;
    return size_ - 3;
  };
  int before = fixed ? -1 : next_separator();
  for (FrameIndex first; first == 0 || first < last; first = first + kSegmentFrames) {
    GraphSegment& segment = segments_.emplace_back();
    segment.run = run;
    segment.first = first;
    segment.last = std::min(first + kSegmentFrames, last);
    const int after = segment.last > first ? next_separator() : -1;
    AppendPose(before, &segment.boundary);
    AppendPose(after, &segment.boundary);
    before = after;
  }
}

void GraphSegments::AddObservation(const GraphObservation& observation, ObservationIndex index) {
  const RunIndex run = observation.run;
  const int at = std::min(first_segment_[run] + observation.frame.value() / kSegmentFrames,
                          first_segment_[run + 1] - 1);
  GraphSegment& segment = segments_[static_cast<std::size_t>(at)];
  const int unknown = first_mode_ + 2 * observation.mode.value();
  const auto found =
      std::find(segment.boundary.begin() + kFirstModeColumn, segment.boundary.end(), unknown);
  segment.observations.push_back(index);
  segment.mode_columns.push_back(static_cast<int>(found - segment.boundary.begin()));
  if (found != segment.boundary.end()) return;
  segment.boundary.push_back(unknown);
  segment.boundary.push_back(unknown + 1);
}

std::vector<int> GraphSegments::UnknownsOf(const std::vector<ModeIndex>& modes) const {
  std::vector<int> unknowns;
  for (const ModeIndex mode : modes) {
    const int first = first_mode_ + 2 * mode.value();
    unknowns.insert(unknowns.end(), {first, first + 1});
  }
  return unknowns;
}

}  // namespace shiftmap
