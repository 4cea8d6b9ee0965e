// SPDX-License-Identifier: Apache-2.0
//
// T-IV figure 7: landmarks that move against landmarks that stay, when fewer and fewer of these are
// left.
#pragma once

#include <cstdint>

#include "tools/experiment/tiv_world.h"

namespace shiftmap {

/// Distances from the truth after the last scan of a drive. [m]
struct TivRemovalRun {
  double best_active = 0.0;   ///< Of TreeSlam, the leaf that is nearest.
  double most_likely = 0.0;   ///< Of TreeSlam, the likeliest leaf.
  double memory_decay = 0.0;  ///< StaticPolicy::kAddUngated without the original corners.
  double rejection = 0.0;     ///< StaticPolicy::kIgnore.
  double reckoning = 0.0;
};

/// The world after a drive through the modified version: its map has the corners at both places,
/// and the modified ones hold.
/// Errors: those of the simulator.
StatusOr<TivWorld> MapBothVersions(const TivWorld& world, std::uint64_t seed);

/// A drive through the original version, past the corners that move, on the map of both.
/// @param share  Of the landmarks that stay, taken out of the map and of the scans, in [0, 1].
/// Errors: those of the simulator; kInvalidArgument if the drive sees no corner.
StatusOr<TivRemovalRun> RunTivRemoval(const TivWorld& both, double share, std::uint64_t seed);

}  // namespace shiftmap
