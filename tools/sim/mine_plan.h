// SPDX-License-Identifier: Apache-2.0
//
// The plan of a mine level: walls, and what a simulation needs to know of them.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "proto/core/status.h"
#include "tools/sim/wall.h"

namespace shiftmap {

/// The two maps of T-IV figure 5: in the modified one a drawpoint is longer and a corner is closer
/// to the drift.
enum class PlanVersion { kOriginal, kModified };

/// A corner of the rock that the two versions have at different places. [m], in the map frame.
struct MovedCorner {
  Eigen::Vector2d original;
  Eigen::Vector2d modified;
};

struct MinePlan {
  std::vector<Wall> original;
  std::vector<Wall> modified;

  /// The way that vehicles drive, from the bottom to the top: along the drift. [m]
  std::vector<Eigen::Vector2d> path;

  /// Where a barrier closes a drawpoint: across its entry, the drift to the left of a -> b.
  std::vector<Wall> entries;

  std::vector<MovedCorner> corners;

  const std::vector<Wall>& walls(PlanVersion version) const {
    return version == PlanVersion::kOriginal ? original : modified;
  }
};

/// A level as production areas have it: a drift (the main tunnel) from the origin towards +y, with
/// drawpoints that turn off to either side, and crosscuts to a second drift on its left.
struct MinePlanOptions {
  std::uint64_t seed = 1;
  double length_m = 150.0;           ///< Of the drift, at most 10 km. [m]
  int drawpoints = 8;                ///< >= 2. One of them is extended, and has no barrier.
  int crosscuts = 2;                 ///< >= 0.
  double width_m = 6.0;              ///< Of drifts and crosscuts. [m]
  double drawpoint_width_m = 5.0;    ///< [m]
  double drawpoint_length_m = 10.0;  ///< From the centre of the drift. [m]
  double extension_m = 4.0;          ///< Of the extended drawpoint, in the modified version. [m]
  double corner_shift_m = 1.5;       ///< Of the corner towards the drift, in the same. < 2.5. [m]
  double roughness_m = 0.2;          ///< Standard deviation of the bends of walls. [m]

  /// Errors: kInvalidArgument naming the first member out of range, or if the drawpoints and
  /// crosscuts do not fit along the drift.
  Status Validate() const;
};

/// Draws a plan. Rock that both versions share is the same to the bit.
/// Corners: the two at the end of the extended drawpoint, and that of a bay in the drift's wall.
/// Determinism: the same options give the same plan. Errors: as Validate().
StatusOr<MinePlan> GenerateMinePlan(const MinePlanOptions& options);

}  // namespace shiftmap
