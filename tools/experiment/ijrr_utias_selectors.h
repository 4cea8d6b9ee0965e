// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "mapper/selection/selector.h"
#include "tools/experiment/ijrr_utias_data.h"
#include "tools/experiment/ijrr_utias_score.h"
#include "tools/experiment/ijrr_utias_static.h"

namespace shiftmap {

/// The system of IJRR 8.2.2 with one of its selectors.
struct UtiasSelectorOptions {
  SelectorOptions selector;
  double prior_sd_m = 0.05;            ///< Of each coordinate in the map.
  double gate_probability = 0.95;      ///< An observation beyond it of all modes makes another.
  double change_probability = 1e-4;    ///< Per observation.
  double detection_probability = 0.6;  ///< Within the field of view.
  double max_range_m = 5.0;            ///< γ_r of IJRR (31).
  double max_bearing_rad = 0.4;        ///< γ_b.
  int max_alternations = 10;           ///< Of selection and solving.
};

/// Modes per observation, IJRR (21)-(31). A filter over pose and modes goes through the run once:
/// what it sees beyond the gate of every mode of a landmark, by the joint marginal of pose and
/// mode, makes a mode, as IJRR 7.1 has it. Then selection over the whole run, missed observations
/// included, and solve in turn until no mode changes. The max-mixture selects after every step of
/// the solver.
///
/// Unlike in the paper the solver is no iSAM2, and modes are made before selections are made again.
UtiasEstimate SolveWithSelector(const UtiasCase& data,
                                const UtiasNoise& noise,
                                const LandmarkPlaces& map,
                                const UtiasSelectorOptions& options);

}  // namespace shiftmap
