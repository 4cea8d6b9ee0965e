// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>
#include <vector>

#include "mapstore/geometry/se2.h"
#include "tools/sim/loader.h"

namespace shiftmap {

struct PathDriverOptions {
  double speed_mps = 2.0;  ///< Top speed, > 0. [m/s]
  bool from_end = false;   ///< Starts at the end of the path, towards its start.
  int legs = 2;            ///< Drives along the path, > 0: there, backwards to its start, ...
};

/// Drives a loader along a polyline by pure pursuit (R. C. Coulter: Implementation of the pure
/// pursuit path tracking algorithm, CMU-RI-TR-92-01, 1992): on the circle through a point of the
/// path ahead, or behind when it drives backwards. A loader does not turn in a tunnel.
class PathDriver {
 public:
  /// @param path  Two points or more, none twice in a row. [m], in the map frame.
  PathDriver(std::span<const Eigen::Vector2d> path,
             const PathDriverOptions& options,
             const LoaderOptions& loader);

  /// On the start of the path, along it.
  Se2 Start() const;

  /// What to do now. Nothing once the last leg is done and the loader stands.
  std::optional<LoaderCommand> Drive(const Se2& T_map_vehicle, double v_mps);

 private:
  double Advance(const Eigen::Vector2d& p_map_vehicle);

  std::vector<Eigen::Vector2d> path_;
  PathDriverOptions options_;
  LoaderOptions loader_;
  double length_m_ = 0.0;
  double progress_m_ = 0.0;  // Of the point of the path that the vehicle is at.
  int leg_ = 0;
};

}  // namespace shiftmap
