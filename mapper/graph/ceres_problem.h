// SPDX-License-Identifier: Apache-2.0
//
// The graph as a Ceres problem. Internal to mapper/graph.
#pragma once

#include <ceres/problem.h>

#include <Eigen/SparseCore>
#include <array>
#include <optional>
#include <vector>

#include "mapper/graph/graph.h"

namespace shiftmap {

/// Owns the parameter blocks and residual blocks of a graph.
class CeresProblem {
 public:
  /// What multiplies the squared Jacobian of an observation's residual (robust_loss.h).
  enum class Weighting {
    kSlope,      ///< Of the gradient: for a minimizer.
    kCurvature,  ///< Of the Hessian: for the posterior.
  };

  /// @param graph  Must outlive the problem.
  CeresProblem(const Graph& graph, Weighting weighting);

  ceres::Problem& problem() { return problem_; }

  /// Copies the present values of the parameters into a graph of the same shape.
  void CopyTo(Graph* graph) const;

  /// The Jacobian of the weighted residuals at the present values, or nothing if it is not finite.
  /// Rows: motions by run (3 each), observations (2 each), priors. Columns: poses by run but the
  /// one that is held (x, y, yaw), calibrations by run, modes.
  std::optional<Eigen::SparseMatrix<double, Eigen::RowMajor>> Jacobian();

 private:
  void AddMotions(const GraphRun& run, RunIndex index);
  void AddCalibrationPriors(const GraphRun& run, RunIndex index);
  void AddObservations(const Graph& graph, Weighting weighting);
  void AddPrior(const GraphPrior& prior);

  IndexedVector<RunIndex, IndexedVector<FrameIndex, std::array<double, 3>>> poses_;
  IndexedVector<RunIndex, std::array<double, 3>> corrections_;
  IndexedVector<RunIndex, std::array<double, 3>> biases_;
  IndexedVector<ModeIndex, std::array<double, 2>> modes_;
  const double* anchor_ = nullptr;  // The pose that is held; null with a prior.
  ceres::Problem problem_;
  std::vector<ceres::ResidualBlockId> residuals_;  // In the order of the rows.
};

}  // namespace shiftmap
