// SPDX-License-Identifier: Apache-2.0
//
// The graph as a Ceres problem; for the trust region. Internal to mapper/graph.
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

 private:
  void AddRun(const GraphRun& run, std::size_t index);
  void AddObservations(const Graph& graph);
  void AddPrior(const GraphPrior& prior);

  std::vector<std::vector<std::array<double, 3>>> poses_;
  std::vector<std::array<double, 3>> corrections_;
  std::vector<std::array<double, 3>> biases_;
  std::vector<std::array<double, 2>> modes_;
  ceres::Problem problem_;
};

}  // namespace shiftmap
