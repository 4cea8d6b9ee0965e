// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "mapper/mapper_options.h"
#include "mapper/problem/map_problem.h"
#include "mapper/submaps/submap.h"

namespace shiftmap {

/// Finds more modes of an aligned submap that are modes of the map: a submap of a long run is bent,
/// and what a rigid transform leaves apart at its ends is one place all the same.
///
/// Given the modes p_M known to stand at z_M in the map, the others are expected at
///
///   p + P_·M (P_MM + R)⁻¹ (z_M - p_M)
///
/// with P the submap's joint covariance, its datum and scale left free, and are known there by the
/// conditional covariance. One that gates with a mode of its group becomes known too, those known
/// to 0.5 m first, and so on outward until no other does. What the other matches contradict (each
/// left out in turn) is none.
/// @param known  Per mode of the submap, flat, the mode of its group in the map, or kUnassigned.
/// @param fixed  Per mode whether `known` is the last word on it.
/// @return `known` with what was found.
std::vector<int> GrowMatches(const MapperOptions& options,
                             const Submap& submap,
                             const MapProblem& map,
                             std::vector<int> known,
                             const std::vector<bool>& fixed);

/// Finds the modes of a bent submap in the map and bends it onto them, in turn until no more are
/// found.
/// @param places  Per mode of the submap, flat, where the map has it as far as is known yet. [m]
/// @param submap  Moved into the map frame.
/// @return Per mode the mode of its group in the map, or kUnassigned.
std::vector<int> FitBentSubmap(const MapperOptions& options,
                               const MapProblem& map,
                               const std::vector<std::optional<Eigen::Vector2d>>& places,
                               Submap* submap);

/// What holds a submap's known modes where the map has them, or some of them all over it.
/// @param known  As of GrowMatches().
std::vector<GraphPrior> HoldKnown(const MapperOptions& options,
                                  const MapProblem& map,
                                  const std::vector<int>& known,
                                  const Submap& submap);

/// Bends a submap, its trajectory with it, by a solve of its run with some of its modes held.
/// @param steps  Of the solver at most.
void Bend(const MapperOptions& options,
          const std::vector<GraphPrior>& held,
          int steps,
          Submap* submap);

/// Bends a submap so that known modes come to stand where the map has them: some steps that a solve
/// of all runs goes on from.
/// @param known  As of GrowMatches().
void BendOntoMap(const MapperOptions& options,
                 const MapProblem& map,
                 const std::vector<int>& known,
                 Submap* submap);

}  // namespace shiftmap
