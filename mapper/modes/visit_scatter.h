// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <map>

#include "mapper/mapper_options.h"
#include "mapper/state/build_state.h"

namespace shiftmap {

/// Variance of what the visits of a build share beside the noise of their sightings: of poses, and
/// of the sensor where its errors last. Visit v puts its landmark δ_v from the weighted mean of the
/// mode's visits, by its sightings with the covariance C_v, and poses that are fitted take a part
/// of the noise, so that Σ δ_vᵀ (C_v + s² I)⁻¹ δ_v is at most χ² of two degrees of freedom a visit
/// but one. With this s² the median mode is as expected; where fewer than four modes tell, it is
/// ModeOptions::score_position_sd_m squared. [m²]
/// @param build  Solved.
double SharedVisitVariance(const ModeOptions& options, const BuildState& build, int threads);

/// Modes whose visits scatter about them by more than that: significant as of two modes
/// (ModeOptions::merge_probability). Of each the mean square that is more. One mode between two
/// places of a landmark that are not told apart is known no better than they are apart. [m²]
/// @param build  Solved.
std::map<ModeIndex, Eigen::Matrix2d> VisitScatter(const ModeOptions& options,
                                                  const BuildState& build,
                                                  int threads);

}  // namespace shiftmap
