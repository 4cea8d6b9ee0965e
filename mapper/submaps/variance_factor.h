// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include "mapper/mapper_options.h"
#include "mapper/problem/map_problem.h"

namespace shiftmap {

/// By how much the covariance of a problem's modes is to be multiplied so that it has the errors
/// that the runs themselves show: residuals that are correlated over time, or are not of the noise
/// that is assumed, make a map worse than its covariance says. At least 1.
///
/// Delete-a-block jackknife (Künsch 1989): the problem is solved again without the visits of each
/// of B stretches of time. With δ_b the change of the modes, and the directions N in which a map
/// moves, turns and grows taken out,
///
///   factor = (B-1)/B Σ_b δ_bᵀ (P⁻¹ - P⁻¹N (NᵀP⁻¹N)⁻¹ NᵀP⁻¹) δ_b / (2n - 4).
///
/// Costs about as much as B solves from near the minimum.
/// @param problem     Solved. Visits that alone hold a mode stay.
/// @param covariance  P, of its modes, positive definite. [m²]
double VarianceFactor(const MapperOptions& options,
                      const MapProblem& problem,
                      const Eigen::MatrixXd& covariance);

}  // namespace shiftmap
