// SPDX-License-Identifier: Apache-2.0
#include <ceres/solver.h>

#include "localizer/models/observation_model.h"
#include "mapper/graph/graph.h"
#include "mapper/graph/graph_problem.h"
#include "mapstore/geometry/covariance.h"

namespace shiftmap {

GraphSummary SolveGraph(int max_iterations, Graph* graph) {
  GraphProblem problem(*graph);
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  options.max_num_iterations = max_iterations;
  options.num_threads = 1;  // Ceres does not give the same bits across threads.
  options.function_tolerance = 1e-7;
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
