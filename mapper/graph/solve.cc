// SPDX-License-Identifier: Apache-2.0
#include <ceres/solver.h>

#include "localizer/models/observation_model.h"
#include "mapper/graph/elimination.h"
#include "mapper/graph/graph.h"
#include "mapper/graph/graph_problem.h"
#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

// Less than this share of the cost is no decrease: a thousand residuals then lack a hundredth.
constexpr double kCostTolerance = 1e-5;

// A step that does not help is halved as often; then the trust region takes over.
constexpr int kMaxHalvings = 3;

}  // namespace

GraphSummary SolveGraph(int max_iterations, Graph* graph) {
  GraphElimination elimination(*graph);
  GraphSummary summary;
  if (!elimination.Linearize()) return SolveGraphByTrustRegion(max_iterations, graph);
  summary.initial_cost = elimination.cost();
  summary.final_cost = elimination.cost();
  while (summary.iterations < max_iterations && !summary.converged) {
    GraphStep step = elimination.Step();
    Apply(step, graph);
    ++summary.iterations;
    bool down = elimination.Linearize() &&
                elimination.cost() <= summary.final_cost * (1.0 + kCostTolerance);
    for (int i = 0; i < kMaxHalvings && !down; ++i) {
      step = Scaled(step, -0.5);
      Apply(step, graph);
      step = Scaled(step, -1.0);
      down = elimination.Linearize() && elimination.cost() <= summary.final_cost;
    }
    if (!down) {
      Apply(Scaled(step, -1.0), graph);
      return SolveGraphByTrustRegion(max_iterations, graph);
    }
    summary.converged =
        summary.final_cost - elimination.cost() <= kCostTolerance * elimination.cost();
    summary.final_cost = elimination.cost();
  }
  return summary;
}

GraphSummary SolveGraphByTrustRegion(int max_iterations, Graph* graph) {
  GraphProblem problem(*graph);
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  options.max_num_iterations = max_iterations;
  options.num_threads = 1;  // Ceres does not give the same bits across threads.
  options.function_tolerance = kCostTolerance;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem.problem(), &summary);
  if (summary.IsSolutionUsable()) problem.CopyTo(graph);
  return {summary.initial_cost,
          summary.final_cost,
          static_cast<int>(summary.iterations.size()),
          summary.termination_type == ceres::CONVERGENCE};
}

double SquaredResidual(const Graph& graph, const GraphObservation& observation) {
  const GraphRun& run = graph.runs[static_cast<std::size_t>(observation.run)];
  const Innovation innovation =
      LinearizeBiased(observation.observation,
                      run.poses[static_cast<std::size_t>(observation.frame)],
                      graph.modes[static_cast<std::size_t>(observation.mode)],
                      run.sensor_bias,
                      observation.mean_squared_bearing);
  return SquaredMahalanobis(innovation.nu, observation.cov_z);
}

}  // namespace shiftmap
