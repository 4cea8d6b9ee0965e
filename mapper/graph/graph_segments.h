// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "mapper/graph/graph.h"

namespace shiftmap {

/// Poses between two separators. More make the reduced system smaller and let a segment see more
/// modes.
inline constexpr int kSegmentPoses = 15;

/// Columns of a segment's boundary: its separators, the calibration of its run, modes.
inline constexpr int kSeparatorBefore = 0;
inline constexpr int kSeparatorAfter = 3;
inline constexpr int kCorrectionColumn = 6;
inline constexpr int kBiasColumn = 9;  ///< Its first, the range scale, is in motions too.
inline constexpr int kFirstModeColumn = 12;

/// Frames [first, last] of a run, the outer two its separators; last == first if there is one
/// frame.
struct GraphSegment {
  RunIndex run;
  FrameIndex first;
  FrameIndex last;

  /// In frames [first, last), or [first, last] at a run's end.
  std::vector<ObservationIndex> observations;
  std::vector<int> boundary;      ///< Unknowns of the reduced system, -1 if fixed.
  std::vector<int> mode_columns;  ///< Per observation the first column of its mode.

  /// Poses inside, which are eliminated.
  int poses() const { return last > first ? last - first - 1 : 0; }
};

/// Where a variable of a residual is: a pose inside a segment, or a column of its boundary.
struct SegmentVariable {
  int pose = -1;
  int column = -1;
};

/// That of the pose of a frame.
SegmentVariable PoseVariable(const GraphSegment& segment, FrameIndex frame);

/// How the poses of a graph are cut into segments, and the order of what they leave: separators,
/// calibrations, modes.
class GraphSegments {
 public:
  explicit GraphSegments(const Graph& graph);

  const std::vector<GraphSegment>& all() const { return segments_; }
  int first_calibration() const { return first_calibration_; }
  int first_mode() const { return first_mode_; }
  int size() const { return size_; }  ///< Unknowns.

  /// The unknowns of some modes, two each.
  std::vector<int> UnknownsOf(const std::vector<ModeIndex>& modes) const;

 private:
  void AddRun(const Graph& graph, RunIndex run);
  void AddObservation(const GraphObservation& observation, ObservationIndex index);

  std::vector<GraphSegment> segments_;
  IndexedVector<RunIndex, int> first_segment_;  // And how many there are.
  int first_calibration_ = 0;
  int first_mode_ = 0;
  int size_ = 0;
};

}  // namespace shiftmap
