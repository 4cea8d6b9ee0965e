// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "proto/core/status.h"
#include "tools/sim/mine_plan.h"
#include "tools/sim/ray_caster.h"
#include "tools/sim/simulated_world.h"

namespace shiftmap {

/// The landmarks of a mine that have signatures.
struct MineLandmarkOptions {
  std::uint64_t seed = 1;

  /// Drawpoints that one barrier is hung at in turn; there are as many barriers as that takes, and
  /// no drawpoint has two. >= 1.
  int places_per_barrier = 3;

  int tags = 16;             ///< On the walls along the path. >= 0.
  int places_per_tag = 2;    ///< >= 1.
  double place_gap_m = 2.0;  ///< Least distance between any two places of tags. >= 0. [m]

  /// The corners that moved have signatures, as in T-IV IX-B.
  bool corners = false;

  /// Errors: kInvalidArgument naming the first member out of range.
  Status Validate() const;
};

/// A plan with its landmarks.
struct MineSite {
  MinePlan plan;

  /// Barriers, then corners, then tags; by ascending signature. The two modes of a corner are where
  /// the original and the modified version have it.
  std::vector<SimulatedGroup> groups;

  /// By barrier and mode: what is closed where it stands, one wall per place.
  std::vector<std::vector<Wall>> barriers;

  std::size_t corners = 0;  ///< Groups that are corners: those after the barriers.

  /// States with the corners as a version has them. @param active_mode  By group.
  std::vector<ModeNumber> WithCornersOf(PlanVersion version,
                                        std::vector<ModeNumber> active_mode) const;

  /// Number of places of each group.
  std::vector<int> ModeCounts() const;

  /// What stands in a shift: rock and barriers. Precondition: active_mode fits the groups.
  std::vector<Wall> WallsOf(PlanVersion version, const std::vector<ModeNumber>& active_mode) const;
};

/// Hangs barriers and tags. Tags are 5 cm in front of rock that both versions share, in sight of
/// the path with every barrier closed. Determinism: the same input gives the same site. Errors: as
/// Validate(), and kInvalidArgument if the tags do not fit.
StatusOr<MineSite> MakeMineSite(MinePlan plan, const MineLandmarkOptions& options);

}  // namespace shiftmap
