// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <limits>
#include <memory>
#include <optional>
#include <utility>

#include "localizer/models/observation_model.h"
#include "mapper/graph/graph.h"
#include "mapper/graph/open_chain.h"
#include "mapper/graph/schur_posterior.h"
#include "mapper/graph/schur_system.h"
#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

// A step that raises the cost by no more than this share of it has not failed.
constexpr double kRounding = 1e-5;

// A step that does not help is halved as often; then steps are damped.
constexpr int kMaxHalvings = 3;

// Removes the rigid motion of all modes from a step, of modes and poses. No residual changes by a
// rigid motion of everything, but a long linear step is none: modes go straight where they ought to
// turn. A step with the first pose of one run fixed has one whenever the start of that run turns
// against everything else.
void RemoveRigidMotion(const Graph& graph, GraphStep* step) {
  const auto count = static_cast<double>(graph.modes.size());
  Eigen::Vector2d centroid = Eigen::Vector2d::Zero();
  Eigen::Vector2d shift = Eigen::Vector2d::Zero();
  for (const ModeIndex m : graph.modes.indices()) {
    centroid += graph.modes[m] / count;
    shift += step->modes.segment<2>(2 * m) / count;
  }
  double turning = 0.0;
  double spread = 0.0;
  for (const ModeIndex m : graph.modes.indices()) {
    const Eigen::Vector2d q = graph.modes[m] - centroid;
    const Eigen::Vector2d moved = step->modes.segment<2>(2 * m) - shift;
    turning += q.x() * moved.y() - q.y() * moved.x();
    spread += q.squaredNorm();
  }
  const double turn = spread > 0.0 ? turning / spread : 0.0;
  const auto motion_at = [&](const Eigen::Vector2d& p) -> Eigen::Vector2d {
    const Eigen::Vector2d q = p - centroid;
    return shift + turn * Eigen::Vector2d(-q.y(), q.x());
  };
  for (const ModeIndex m : graph.modes.indices()) {
    step->modes.segment<2>(2 * m) -= motion_at(graph.modes[m]);
  }
  for (const RunIndex r : graph.runs.indices()) {
    for (const FrameIndex i : graph.runs[r].poses.indices()) {
      const Se2& T_map_vehicle = graph.runs[r].poses[i];
      auto xi = step->poses[r].segment<3>(3 * i);
      xi.head<2>() -= T_map_vehicle.Rotation().transpose() * motion_at(T_map_vehicle.translation());
      xi[2] -= turn;
    }
  }
}

// Moves everything rigidly so that the pose that fixes the frame is where it was.
void RestoreFrame(const Se2& T_map_anchor, Graph* graph) {
  Se2& anchor = graph->runs[graph->anchor_run].poses.front();
  const Se2 T_map_moved = T_map_anchor * anchor.Inverse();
  for (GraphRun& run : graph->runs) {
    for (Se2& pose : run.poses) pose = T_map_moved * pose;
  }
  for (Eigen::Vector2d& mode : graph->modes) mode = T_map_moved * mode;
  anchor = T_map_anchor;
}

// A step that is expected to lower the cost by a smaller share is near the minimum: the curvature
// of the loss takes the place of its weights from there on.
constexpr double kNearMinimum = 1e-2;

// If the cost falls more than the quadratic model predicts, as where outliers are being
// down-weighted, the next steps are up to so many times as long.
constexpr double kMaxLength = 1.5;

// Everything continuous in a graph.
class GraphValues {
 public:
  explicit GraphValues(const Graph& graph) : modes_(graph.modes) {
    for (const GraphRun& run : graph.runs) {
      runs_.push_back({run.poses, run.correction, run.sensor_bias});
    }
  }

  void CopyTo(Graph* graph) const {
    graph->modes = modes_;
    for (const RunIndex r : runs_.indices()) {
      graph->runs[r].poses = runs_[r].poses;
      graph->runs[r].correction = runs_[r].correction;
      graph->runs[r].sensor_bias = runs_[r].sensor_bias;
    }
  }

 private:
  struct Run {
    IndexedVector<FrameIndex, Se2> poses;
    Eigen::Vector3d correction;
    SensorBias sensor_bias;
  };
  IndexedVector<RunIndex, Run> runs_;
  IndexedVector<ModeIndex, Eigen::Vector2d> modes_;
};

// Gauss-Newton steps until the cost stays.
class GaussNewton {
 public:
  /// @param near_minimum  Of the graph to begin with.
  GaussNewton(const SolverLimits& limits, bool near_minimum, SchurSystem* system, Graph* graph)
      : limits_(limits),
        near_minimum_(near_minimum),
        system_(*system),
        graph_(*graph),
        frame_is_free_(graph->priors.empty() && !graph->modes.empty()) {
    if (graph->open) open_chain_.emplace(*graph);
  }

  // The first linearization. False if a segment is not determined.
  bool Start() {
    if (!Linearize()) return false;
    summary_.initial_cost = summary_.final_cost = system_.cost();
    return true;
  }

  // False if a step is not determined or does not go down; the graph is then where it was before
  // that step.
  bool Run() {
    while (summary_.iterations < limits_.max_iterations && !summary_.converged) {
      std::optional<SchurSystem::Step> found = system_.Solve();
      if (!found) return false;
      const double expected = found->expected_decrease;
      const GraphStep step = Adjusted(*std::move(found));
      const GraphValues before(graph_);
      Move(step);
      ++summary_.iterations;
      if (IsLast(expected) && Ends()) return true;
      if (!GoDown(before, step)) return false;
      const double decrease = summary_.final_cost - system_.cost();
      length_ = NextLength(expected, decrease);
      summary_.converged = decrease <= limits_.cost_tolerance * system_.cost();
      summary_.final_cost = system_.cost();
    }
    return true;
  }

  const GraphSummary& summary() const { return summary_; }
  bool near_minimum() const { return near_minimum_; }

 private:
  bool Linearize() {
    return system_.Linearize(near_minimum_ ? LossWeighting::kStepCurvature
                                           : LossWeighting::kWeights);
  }

  // A step as it is taken: longer near the minimum, and without what moves the frame.
  GraphStep Adjusted(SchurSystem::Step found) {
    near_minimum_ = found.expected_decrease <= kNearMinimum * summary_.final_cost;
    if (!near_minimum_) length_ = 1.0;
    GraphStep step = std::move(found.step);
    if (length_ > 1.0) step = Scaled(std::move(step), length_);
    if (frame_is_free_ && !open_chain_) RemoveRigidMotion(graph_, &step);
    return step;
  }

  // Nothing is linearized after the last step.
  bool IsLast(double expected) const {
    return summary_.iterations == limits_.max_iterations ||
           expected <= limits_.cost_tolerance * summary_.final_cost;
  }

  bool Ends() {
    const double cost = system_.PresentCost();
    const bool converged = summary_.final_cost - cost <= limits_.cost_tolerance * cost;
    if (!(cost <= summary_.final_cost * (1.0 + kRounding))) return false;
    if (!converged && summary_.iterations < limits_.max_iterations) return false;
    summary_.converged = converged;
    summary_.final_cost = cost;
    return true;
  }

  void Move(const GraphStep& step) {
    if (open_chain_) {
      open_chain_->Apply(step, &graph_);
    } else {
      Apply(step, &graph_);
    }
  }

  // Linearizes where a step has led, or halfway.
  bool GoDown(const GraphValues& before, GraphStep step) {
    if (Linearize() && system_.cost() <= summary_.final_cost * (1.0 + kRounding)) return true;
    for (int i = 0; i < kMaxHalvings; ++i) {
      before.CopyTo(&graph_);
      step = Scaled(std::move(step), 0.5);
      Move(step);
      if (Linearize() && system_.cost() <= summary_.final_cost) return true;
    }
    before.CopyTo(&graph_);
    return false;
  }

  // The cost along a step is a parabola by what was expected and what came of it: where it has its
  // minimum.
  double NextLength(double expected, double decrease) const {
    const double curvature = (2.0 * expected * length_ - decrease) / (length_ * length_);
    if (curvature * kMaxLength <= expected) return kMaxLength;
    return std::max(1.0, expected / curvature);
  }

  SolverLimits limits_;
  bool near_minimum_;
  SchurSystem& system_;
  Graph& graph_;
  GraphSummary summary_;
  bool frame_is_free_;
  std::optional<OpenChain> open_chain_;
  double length_ = 1.0;
};

constexpr double kFirstDamping = 1e-3;

// Levenberg and Marquardt, from where steps of Gauss-Newton do not go down: until the cost stays.
// If no step reduces the cost, the point counts as converged.
void DampedGaussNewton(const SolverLimits& limits,
                       SchurSystem* system,
                       Graph* graph,
                       GraphSummary* summary) {
  constexpr double kMaxDamping = 1e6;
  constexpr double kFactor = 10.0;
  double damping = kFirstDamping;
  while (summary->iterations < limits.max_iterations && !summary->converged) {
    if (damping > kMaxDamping) {
      summary->converged = true;
      return;
    }
    std::optional<SchurSystem::Step> found;
    if (system->Linearize(LossWeighting::kWeights, damping)) found = system->Solve();
    ++summary->iterations;
    if (!found) {
      damping *= kFactor;
      continue;
    }
    const GraphValues before(*graph);
    Apply(found->step, graph);
    if (!system->Linearize(LossWeighting::kWeights) || system->cost() > summary->final_cost) {
      before.CopyTo(graph);
      damping *= kFactor;
      continue;
    }
    summary->converged =
        summary->final_cost - system->cost() <= limits.cost_tolerance * system->cost();
    summary->final_cost = system->cost();
    damping /= kFactor;
  }
}

}  // namespace

GraphSolver::GraphSolver() = default;
GraphSolver::~GraphSolver() = default;

std::unique_ptr<GraphPosterior> GraphSolver::Linearize(const Graph& graph) {
  if (graph.solver == SolverKind::kCeres) return LinearizeGraph(graph);
  return SchurPosterior::Of(graph, {}, &reduced_);
}

GraphSummary GraphSolver::Solve(const SolverLimits& limits, Graph* graph) {
  if (graph->solver == SolverKind::kCeres) return SolveGraphByCeres(limits, graph);
  SchurSystem system(*graph, std::move(reduced_));
  const Se2 T_map_anchor = graph->runs[graph->anchor_run].poses.front();
  GaussNewton gauss_newton(limits, near_minimum_, &system, graph);
  if (!gauss_newton.Start()) {
    // Indefinite even with damping: values are not finite, and Ceres would log pages of errors.
    if (!system.Linearize(LossWeighting::kWeights, kFirstDamping)) {
      constexpr double kNone = std::numeric_limits<double>::infinity();
      return {kNone, kNone};
    }
    return SolveGraphByCeres(limits, graph);
  }
  const bool solved = gauss_newton.Run();
  near_minimum_ = gauss_newton.near_minimum();
  GraphSummary summary = gauss_newton.summary();
  if (!solved) DampedGaussNewton(limits, &system, graph, &summary);
  if (graph->priors.empty()) RestoreFrame(T_map_anchor, graph);
  reduced_ = system.TakeReduced();
  return summary;
}

GraphSummary SolveGraph(const SolverLimits& limits, Graph* graph) {
  return GraphSolver().Solve(limits, graph);
}

}  // namespace shiftmap
