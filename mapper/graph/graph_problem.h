// SPDX-License-Identifier: Apache-2.0
//
// The graph as a Ceres problem; shared by the solver and the posterior. Internal to mapper/graph.
#pragma once

#include <ceres/problem.h>

#include <array>
#include <vector>

#include "mapper/graph/graph.h"

namespace shiftmap {

/// Owns the parameter blocks and residual blocks of a graph.
class GraphProblem {
 public:
  /// @param graph  Must outlive the problem.
  explicit GraphProblem(const Graph& graph);

  ceres::Problem& problem() { return problem_; }

  /// Copies the present values of the parameters into a graph of the same shape.
  void CopyTo(Graph* graph) const;

  /// Free parameter blocks: poses first, then calibrations and, last, modes.
  std::vector<double*> FreePoses();
  std::vector<double*> CalibrationsAndModes();

  /// Residual blocks by kind: motions, then observations in graph order; priors are not among them.
  const std::vector<ceres::ResidualBlockId>& motions() const { return motions_; }
  const std::vector<ceres::ResidualBlockId>& observations() const { return observations_; }

 private:
  void AddRun(const GraphRun& run, std::size_t index);
  void AddObservations(const Graph& graph);
  void AddPrior(const GraphPrior& prior);

  std::vector<std::vector<std::array<double, 3>>> poses_;
  std::vector<std::array<double, 3>> corrections_;
  std::vector<std::array<double, 2>> biases_;
  std::vector<std::array<double, 2>> modes_;
  const double* anchor_ = nullptr;
  std::vector<ceres::ResidualBlockId> motions_;
  std::vector<ceres::ResidualBlockId> observations_;
  ceres::Problem problem_;
};

}  // namespace shiftmap
