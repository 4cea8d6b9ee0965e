// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "mapstore/run/run.h"

namespace shiftmap {

/// When a landmark moves while it is in view (moving_visits.h).
struct MovingVisitOptions {
  /// A landmark is looked at again once it must be seen this far from before in the vehicle frame,
  /// if that is within a time over which odometry can be asked. [m], [s]
  double min_way_m = 2.0;
  double max_time_s = 5.0;

  /// It moved if it is off by more than this share of the way; raising it makes fewer moves.
  double moved_share = 0.5;

  /// Moves of a visit, and for each time that it stood, for the visit to be left out.
  int min_moves = 8;
  int min_moves_per_standing = 2;
};

struct FrontEndOptions {
  /// A group unseen for longer than this starts another visit. [s]. Raising it makes fewer, longer
  /// visits, in which the landmark is then assumed not to move.
  double visit_gap_s = 10.0;

  /// Two sightings of one signature in one scan further apart than this are two landmarks. [m]
  double duplicate_distance_m = 0.5;

  /// A range and bearing nearer than this is left out: centimetres turn such a bearing by tenths of
  /// a radian, which no step of a solver foresees. [m]
  double min_range_m = 0.2;

  MovingVisitOptions moving;
};

/// The observations of a scan that can be used: not too near, each signature at one place only.
struct UsableSightings {
  std::vector<int> named;      ///< Indices in the scan, by signature, each signature once.
  std::vector<int> anonymous;  ///< Indices of those without a signature, ascending.
  int duplicate = 0;           ///< One signature at two places: all of it left out.
  int near = 0;                ///< Nearer than min_range_m: left out.
};
UsableSightings FindUsableSightings(const Scan& scan, const FrontEndOptions& options);

}  // namespace shiftmap
