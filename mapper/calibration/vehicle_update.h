// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "mapper/calibration/vehicle_calibration.h"
#include "mapstore/map/vehicle_calibration.h"

namespace shiftmap {

/// Takes what a build found of its vehicles into what the map before it knew; vehicles that the
/// build did not see stay as they were, bit for bit.
///
/// - Systematic errors: of N(ĉ, C) found under the fleet's prior N(c₀, P₀), the R runs alone say
///   L = C⁻¹ - P₀⁻¹, h = C⁻¹ ĉ - P₀⁻¹ c₀. Each run differs from its vehicle by T = kRunSpread², so
///   that of the vehicle they say less. With N(c_p, P_p) known, or the fleet's prior,
///
///     L' = (I + L T/R)⁻¹ L,  h' = (I + L T/R)⁻¹ h,  Λ = P_p⁻¹ + L',  c = Λ⁻¹ (P_p⁻¹ c_p + h')
///
///   counts that prior once. P_p is diagonal, grown by a random walk since the vehicle's last run:
///   wheels wear. Errors of the map that the nights have in common count as independent.
/// - Noise and P_D0: pooled by degrees of freedom and trials, of which a bounded number is
///   remembered, so that the calibration follows the vehicle.
/// - A vehicle that contradicts what is known of it (probability below 1e-6) has another sensor or
///   other wheels: what was known is dropped.
///
/// Vehicles without a name are left out: nobody can ask for them. So is what is found in no numbers
/// that a calibration may have, as of a run that makes no sense; what was known then stays.
/// @param known  By name; in and out.
void UpdateVehicles(const std::vector<VehicleEstimate>& found,
                    std::vector<VehicleCalibration>* known);

}  // namespace shiftmap
