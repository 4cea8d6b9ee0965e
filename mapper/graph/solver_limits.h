// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace shiftmap {

/// What minimizes graphs and tells their posterior.
enum class SolverKind {
  kSchur,  ///< Nested elimination of the chains of poses (schur_system.h).
  kCeres,  ///< Ceres throughout: minimum, residuals and Jacobians of the posterior.
};

/// When a minimization ends.
struct SolverLimits {
  int max_iterations = 50;  ///< >= 1.

  /// The last step is one that lowers the cost by less than this share: at the default a thousand
  /// residuals lack a hundredth.
  double cost_tolerance = 1e-5;
};

}  // namespace shiftmap
