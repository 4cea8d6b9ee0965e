// SPDX-License-Identifier: Apache-2.0
//
// Tunnels in rock as polygons, and the walls of all of them together.
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "tools/sim/random.h"
#include "tools/sim/wall.h"

namespace shiftmap {

/// A simple polygon, open space inside. [m]
using Outline = std::vector<Eigen::Vector2d>;

struct RoughRock {
  double sd_m = 0.0;    ///< Of a wall's bends, across the tunnel. [m]
  double step_m = 2.0;  ///< From bend to bend, > 0. [m]
};

/// The two walls of a tunnel from its start on, as many points on either.
struct TunnelSides {
  std::vector<Eigen::Vector2d> left;
  std::vector<Eigen::Vector2d> right;

  Outline ToOutline() const;
};

/// The point `distance_m` along a polyline; before its start and past its end, its ends.
/// Precondition: two points or more, none twice in a row.
Eigen::Vector2d PointAlong(std::span<const Eigen::Vector2d> line, double distance_m);

double LengthOf(std::span<const Eigen::Vector2d> line);

/// The walls of a tunnel around a centre line, bent at random except where it starts and ends.
/// Precondition: as PointAlong; bends of the centre line are wide compared with the tunnel.
TunnelSides DigTunnel(std::span<const Eigen::Vector2d> centre,
                      double width_m,
                      const RoughRock& rock,
                      Random* random);

/// Whether a point is inside of a polygon, by the even-odd rule.
bool IsInside(const Outline& outline, const Eigen::Vector2d& p);

/// The border of the union of polygons: of each, the pieces that are inside of no other.
std::vector<Wall> WallsOfUnion(std::span<const Outline> outlines);

}  // namespace shiftmap
