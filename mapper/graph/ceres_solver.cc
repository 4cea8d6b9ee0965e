// SPDX-License-Identifier: Apache-2.0
#include <ceres/solver.h>

#include <algorithm>
#include <limits>

#include "mapper/graph/ceres_problem.h"
#include "mapper/graph/graph.h"

namespace shiftmap {
namespace {

// Damped steps are shorter than those that SolverLimits counts.
constexpr int kLeastIterations = 50;

}  // namespace

GraphSummary SolveGraphByCeres(const SolverLimits& limits, Graph* graph) {
  CeresProblem problem(*graph, CeresProblem::Weighting::kSlope);
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  // Bits that depend neither on the BLAS that is installed nor on threads.
  options.sparse_linear_algebra_library_type = ceres::EIGEN_SPARSE;
  options.num_threads = 1;
  options.max_num_iterations = std::max(kLeastIterations, limits.max_iterations);
  options.function_tolerance = 1e-3 * limits.cost_tolerance;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem.problem(), &summary);
  if (!summary.IsSolutionUsable()) {
    constexpr double kNone = std::numeric_limits<double>::infinity();
    return {kNone, kNone, 0, false};
  }
  problem.CopyTo(graph);
  return {summary.initial_cost,
          summary.final_cost,
          static_cast<int>(summary.iterations.size()),
          summary.termination_type == ceres::CONVERGENCE};
}

}  // namespace shiftmap
