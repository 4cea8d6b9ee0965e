// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

#include "mapstore/run/trajectory.h"
#include "mapstore/store_types.h"
#include "tools/plot/legend.h"
#include "tools/plot/map_frame.h"
#include "tools/plot/svg.h"

namespace shiftmap {

/// Appends the positions of a trajectory. Map frame. [m]
void AppendPositions(const std::vector<StampedPose>& trajectory,
                     std::vector<Eigen::Vector2d>* points);

/// A trajectory in a map, off by `tolerance` pixels at most.
void DrawTrajectory(const std::vector<StampedPose>& trajectory,
                    const MapFrame& frame,
                    const SvgStyle& style,
                    double tolerance,
                    Svg* svg);

/// The trajectories of runs: the newest in colours, the others and those of ancestors in grey. All
/// of them together have a bounded number of points.
class RunLayer {
 public:
  RunLayer(const std::vector<RunRecord>& runs, const std::vector<RunRecord>& earlier)
      : runs_(runs), earlier_(earlier) {}

  std::vector<Eigen::Vector2d> Positions() const;
  void Draw(const MapFrame& frame, Svg* svg) const;
  void AddTo(Legend* legend) const;

 private:
  const std::vector<RunRecord>& runs_;
  const std::vector<RunRecord>& earlier_;
};

}  // namespace shiftmap
