// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "mapper/selection/mode_sequence.h"

namespace shiftmap {

/// One time at which a group was looked for.
struct ObservationStep {
  Eigen::VectorXd detection_probability;  ///< P_D per state, in [0, 1), IJRR (31).

  /// log p(z_t | δ_t) per state; nothing if the landmark was not seen, z_t = ∅.
  std::optional<Eigen::VectorXd> log_density;
};

/// A chain whose steps are observations, as IJRR prints it: ψ = p(δ_t|δ_{t-1}) P_D p(z_t|δ_t), IJRR
/// (27), for what is seen and p(δ_t|δ_{t-1}) (1 - P_D) for what is not. IJRR (28) prints the second
/// without p(δ_t|δ_{t-1}); then a landmark could move at no cost whenever it is not seen.
/// @param initial             Pr(δ_1) per state.
/// @param change_probability  Of leaving a state from one step to the next, spread evenly over the
///                            others; IJRR 8.2.2 takes 1e-4. In [0, 1).
ModeSequenceProblem MakeObservationSequence(const Eigen::VectorXd& initial,
                                            double change_probability,
                                            const std::vector<ObservationStep>& observations);

}  // namespace shiftmap
