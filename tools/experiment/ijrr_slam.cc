// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/ijrr_slam.h"

#include <memory>
#include <set>

#include "localizer/models/observation_model.h"
#include "mapper/graph/graph.h"
#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

constexpr int kSolverIterations = 20;

// Of what the graph could also estimate and this problem does not have.
constexpr double kHeldSd = 1e-9;

Observation CartesianObservation(const Eigen::Vector2d& z) {
  Observation observation;
  observation.kind = Observation::Kind::kCartesian;
  observation.z = z;
  return observation;
}

// The graph with every pose at the origin and every mode where the map has it.
Graph StartGraph(const IjrrSelectorsOptions& options, const IjrrSlamProblem& problem) {
  Graph graph;
  graph.loss_scale = 1e6;  // Least squares, as in the paper.
  graph.modes = problem.prior;
  GraphRun run;
  run.poses.assign(problem.observations.size(), Se2());
  MotionIncrement still;
  still.cov = options.process_sd.cwiseAbs2().asDiagonal();
  run.motions.assign(problem.observations.size() - 1, still);
  run.correction_prior_sd.setConstant(kHeldSd);
  run.sensor_bias_sd.setConstant(kHeldSd);
  graph.runs.push_back(std::move(run));
  return graph;
}

// Switches the observations to the modes of `states`. The first pose is held at the origin, so an
// observation from there is a prior of a mode.
void SwitchObservations(const IjrrSelectorsOptions& options,
                        const IjrrSlamProblem& problem,
                        const std::vector<int>& states,
                        Graph* graph) {
  graph->observations.clear();
  const Eigen::Matrix2d prior_cov =
      Eigen::Matrix2d::Identity() * (options.prior_sd_m * options.prior_sd_m);
  for (std::size_t k = 0; k < problem.prior.size(); ++k) {
    graph->observations.push_back(
        {0, 0, static_cast<int>(k), CartesianObservation(problem.prior[k]), prior_cov, 0.0});
  }
  for (std::size_t t = 0; t < states.size(); ++t) {
    graph->observations.push_back({0,
                                   static_cast<int>(t),
                                   states[t],
                                   CartesianObservation(problem.observations[t]),
                                   Eigen::Matrix2d::Identity() * problem.noise_m2,
                                   0.0});
  }
}

// log p(z_t | x_t, M, δ_t) at the graph's present values, which IJRR 5.3 takes as given.
ModeSequenceProblem MakeSequence(const IjrrSelectorsOptions& options,
                                 const IjrrSlamProblem& problem,
                                 const Graph& graph) {
  const Eigen::Matrix2d cov = Eigen::Matrix2d::Identity() * problem.noise_m2;
  std::vector<Eigen::VectorXd> log_densities;
  for (std::size_t t = 0; t < problem.observations.size(); ++t) {
    Eigen::VectorXd log_density(std::ssize(graph.modes));
    for (std::size_t k = 0; k < graph.modes.size(); ++k) {
      const Innovation innovation = Linearize(
          CartesianObservation(problem.observations[t]), graph.runs[0].poses[t], graph.modes[k]);
      log_density[static_cast<Eigen::Index>(k)] = LogGaussian(innovation.nu, cov);
    }
    log_densities.push_back(std::move(log_density));
  }
  return MakeIjrrSequence(options, log_densities);
}

double SquaredError(const IjrrSelectorsOptions& options,
                    const IjrrSlamProblem& problem,
                    const Graph& graph) {
  const auto last = static_cast<std::size_t>(problem.truth.back());
  const Eigen::Vector2d robot =
      graph.runs[0].poses.back().translation() - problem.true_poses.back().translation();
  return robot.squaredNorm() + (graph.modes[last] - options.places[last]).squaredNorm();
}

}  // namespace

IjrrSlamProblem SimulateIjrrSlam(const IjrrSelectorsOptions& options,
                                 double noise_m2,
                                 std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  const auto draw = [&] { return Eigen::Vector2d(normal(random), normal(random)); };
  IjrrSlamProblem problem;
  problem.noise_m2 = noise_m2;
  for (const Eigen::Vector2d& place : options.places) {
    problem.prior.push_back(place + options.prior_sd_m * draw());
  }
  Se2 T_map_vehicle;
  for (std::size_t k = 0; k < options.places.size(); ++k) {
    for (int i = 0; i < options.observations_per_place; ++i) {
      if (!problem.truth.empty()) {
        const Eigen::Vector2d shift = options.process_sd.head<2>().cwiseProduct(draw());
        const double turn = options.process_sd.z() * normal(random);
        T_map_vehicle = T_map_vehicle * Se2::Exp({shift.x(), shift.y(), turn});
      }
      problem.true_poses.push_back(T_map_vehicle);
      problem.truth.push_back(static_cast<int>(k));
      problem.observations.push_back(T_map_vehicle.Inverse() * options.places[k] +
                                     std::sqrt(noise_m2) * draw());
    }
  }
  return problem;
}

IjrrSlamResult SolveIjrrSlam(const IjrrSelectorsOptions& options,
                             const SelectorOptions& selector_options,
                             const IjrrSlamProblem& problem) {
  const std::unique_ptr<Selector> selector = MakeSelector(selector_options);
  const bool at_linearization = selector_options.kind == SelectorKind::kMaxMixture;
  const int alternations = at_linearization ? kSolverIterations : options.max_alternations;
  const int solver_iterations = at_linearization ? 1 : kSolverIterations;
  Graph graph = StartGraph(options, problem);
  IjrrSlamResult result;
  std::set<std::vector<int>> seen;
  while (result.alternations < alternations) {
    result.states = selector->Select(MakeSequence(options, problem, graph)).states;
    const bool recurs = !seen.insert(result.states).second;
    SwitchObservations(options, problem, result.states, &graph);
    SolveGraph(solver_iterations, &graph);
    ++result.alternations;
    if (recurs) {
      if (at_linearization) SolveGraph(kSolverIterations, &graph);
      break;
    }
  }
  result.squared_error_m2 = SquaredError(options, problem, graph);
  return result;
}

}  // namespace shiftmap
