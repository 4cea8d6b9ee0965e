// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <map>

#include "mapper/mapper_options.h"
#include "mapper/state/build_state.h"

namespace shiftmap {

/// How two maps of the same modes differ: the sum of squares of what should be its degrees of
/// freedom.
struct Disagreement {
  double squares = 0.0;
  double dof = 0.0;

  /// Modes that differ by themselves, by their places among the modes: they are not in the sums.
  /// How each differs from what the others let expect. [m]
  std::map<Eigen::Index, Eigen::Vector2d> outliers = {};
};

/// The differences d of some modes under their information Λ, dᵀΛd, without outliers O, at most
/// half of the modes: by a test for many of them (Rosner 1983), in which the mode goes next by
/// which the sum falls most, (Λd)ᵀ_m Λ⁻¹_mm (Λd)_m, with its two degrees of freedom. They differ
/// from what the others let expect by Λ⁻¹_OO (Λd)_O.
/// @param information  Of the modes, two rows each. [1/m²]
/// @param difference   [m]
/// @param dof          What the sum is expected to be.
Disagreement DisagreementOf(const DisagreementOptions& options,
                            const Eigen::MatrixXd& information,
                            const Eigen::VectorXd& difference,
                            double dof);

/// Estimates what a build's assumed noise does not have: the variance factor of each run, which its
/// own residuals show (VarianceFactor), and BuildState::disagreement: all runs by themselves and
/// the prior map may disagree more about the shape of the map than these covariances say (Birge
/// 1932), and the visits of a mode about it (VisitScatter). In a map of more than kMaxJointModes
/// the latter is in the factors of all runs. A run of fewer than three modes, or of more than
/// ConfirmationOptions::max_modes, or that does not determine them by itself, has no factor of its
/// own; all are taken to agree with one of the latter.
/// The build is to be solved with them.
/// @param build  Solved, with all factors 1.
void EstimateRunVariances(const MapperOptions& options, BuildState* build);

}  // namespace shiftmap
