// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "mapstore/run/run.h"

namespace shiftmap {

struct FrontEndOptions {
  /// A group unseen for longer than this starts another visit. [s]. Raising it makes fewer, longer
  /// visits, in which the landmark is then assumed not to move.
  double visit_gap_s = 10.0;

  /// Two sightings of one signature in one scan further apart than this are two landmarks. [m]
  double duplicate_distance_m = 0.5;

  /// A range and bearing nearer than this is left out: centimetres turn such a bearing by tenths of
  /// a radian, which no step of a solver foresees. [m]
  double min_range_m = 0.2;
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
