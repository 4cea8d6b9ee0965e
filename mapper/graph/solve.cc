// SPDX-License-Identifier: Apache-2.0
#include <ceres/solver.h>

#include <memory>
#include <optional>
#include <utility>

#include "localizer/models/observation_model.h"
#include "mapper/graph/elimination.h"
#include "mapper/graph/graph.h"
#include "mapper/graph/graph_problem.h"
#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

// Less than this share of the cost is no decrease: a thousand residuals then lack a hundredth.
constexpr double kCostTolerance = 1e-5;

// A step that does not help is halved as often; then steps are damped.
constexpr int kMaxHalvings = 3;

// Gauss-Newton from a linearization until the cost stays. False if a step is not determined or does
// not go down; the graph is then where it was before that step.
bool GaussNewton(int max_iterations,
                 GraphElimination* elimination,
                 Graph* graph,
                 GraphSummary* summary) {
  while (summary->iterations < max_iterations && !summary->converged) {
    std::optional<GraphStep> step = elimination->SimilarStep();
    if (!step) return false;
    Apply(*step, graph);
    ++summary->iterations;
    bool down = elimination->LinearizeSegments() &&
                elimination->cost() <= summary->final_cost * (1.0 + kCostTolerance);
    for (int i = 0; i < kMaxHalvings && !down; ++i) {
      step = Scaled(*std::move(step), -0.5);
      Apply(*step, graph);
      step = Scaled(*std::move(step), -1.0);
      down = elimination->LinearizeSegments() && elimination->cost() <= summary->final_cost;
    }
    if (!down) {
      Apply(Scaled(*std::move(step), -1.0), graph);
      return false;
    }
    summary->converged =
        summary->final_cost - elimination->cost() <= kCostTolerance * elimination->cost();
    summary->final_cost = elimination->cost();
  }
  return true;
}

// Levenberg and Marquardt, from where steps of Gauss-Newton do not go down: until the cost stays.
// Where no step goes down however short, that is a minimum up to rounding.
void DampedGaussNewton(int max_iterations,
                       GraphElimination* elimination,
                       Graph* graph,
                       GraphSummary* summary) {
  constexpr double kFirstDamping = 1e-3;
  constexpr double kMaxDamping = 1e6;
  constexpr double kFactor = 10.0;
  double damping = kFirstDamping;
  while (summary->iterations < max_iterations && !summary->converged) {
    if (damping > kMaxDamping) {
      summary->converged = true;
      return;
    }
    std::optional<GraphStep> step;
    if (elimination->LinearizeSegments(damping)) step = elimination->SimilarStep();
    ++summary->iterations;
    if (!step) {
      damping *= kFactor;
      continue;
    }
    Apply(*step, graph);
    if (!elimination->LinearizeSegments() || elimination->cost() > summary->final_cost) {
      Apply(Scaled(*std::move(step), -1.0), graph);
      damping *= kFactor;
      continue;
    }
    summary->converged =
        summary->final_cost - elimination->cost() <= kCostTolerance * elimination->cost();
    summary->final_cost = elimination->cost();
    damping /= kFactor;
  }
}

}  // namespace

GraphSolver::GraphSolver() = default;
GraphSolver::~GraphSolver() = default;

GraphSummary GraphSolver::Solve(int max_iterations, Graph* graph) {
  GraphElimination elimination(*graph, std::move(rest_));
  GraphSummary summary;
  if (!elimination.LinearizeSegments()) return SolveGraphByTrustRegion(max_iterations, graph);
  summary.initial_cost = elimination.cost();
  summary.final_cost = elimination.cost();
  if (!GaussNewton(max_iterations, &elimination, graph, &summary)) {
    DampedGaussNewton(max_iterations, &elimination, graph, &summary);
  }
  rest_ = elimination.TakeRest();
  return summary;
}

GraphSummary SolveGraph(int max_iterations, Graph* graph) {
  return GraphSolver().Solve(max_iterations, graph);
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
