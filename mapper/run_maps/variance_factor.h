// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapper/mapper_options.h"
#include "mapper/state/build_state.h"

namespace shiftmap {

/// By how much the covariance of a build's modes is to be multiplied so that it has the errors
/// that the runs themselves show: residuals that are correlated over time, or are not of the noise
/// that is assumed, make a map worse than its covariance P = H⁻¹ says. At least 1.
///
/// Sandwich estimate with clusters (Liang and Zeger 1986): each of B stretches of time has
/// residuals e_b that by themselves move the modes by δ_b = H⁻¹ J_bᵀ e_b, and Σ_b δ_b δ_bᵀ
/// estimates the covariance whatever the residuals of a stretch have in common. With Q a basis
/// of the changes of the modes that do not translate, rotate or scale the map,
///
///   factor = s(e) / mean over draws of s(ε - J H⁻¹ Jᵀ ε),   s(e) = Σ_b ‖Qᵀ δ_b‖² in (Qᵀ P Q)⁻¹,
///
/// draws of white noise ε: the fit takes as much from them as from the residuals.
/// @param build  Solved.
double VarianceFactor(const MapperOptions& options, const BuildState& build);

}  // namespace shiftmap
