// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <limits>
#include <memory>
#include <optional>
#include <utility>

#include "localizer/models/observation_model.h"
#include "mapper/graph/elimination.h"
#include "mapper/graph/graph.h"
#include "mapper/graph/open_chain.h"
#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

// A step that raises the cost by no more than this share of it has not failed.
constexpr double kRounding = 1e-5;

// A step that does not help is halved as often; then steps are damped.
constexpr int kMaxHalvings = 3;

// Takes the rigid motion of the modes as a whole out of a step, and out of the poses with it. No
// residual changes by a rigid motion of everything, but a long one is none: modes go straight where
// they ought to turn. A step that holds the first pose of one run has one whenever the start of
// that run, by which it hangs on everything else, is turned against it.
void TakeOutRigidMotion(const Graph& graph, GraphStep* step) {
  const auto count = static_cast<double>(graph.modes.size());
  Eigen::Vector2d centroid = Eigen::Vector2d::Zero();
  Eigen::Vector2d shift = Eigen::Vector2d::Zero();
  for (std::size_t m = 0; m < graph.modes.size(); ++m) {
    centroid += graph.modes[m] / count;
    shift += step->modes.segment<2>(static_cast<Eigen::Index>(2 * m)) / count;
  }
  double turning = 0.0;
  double spread = 0.0;
  for (std::size_t m = 0; m < graph.modes.size(); ++m) {
    const Eigen::Vector2d q = graph.modes[m] - centroid;
    const Eigen::Vector2d moved = step->modes.segment<2>(static_cast<Eigen::Index>(2 * m)) - shift;
    turning += q.x() * moved.y() - q.y() * moved.x();
    spread += q.squaredNorm();
  }
  const double turn = spread > 0.0 ? turning / spread : 0.0;
  const auto motion_at = [&](const Eigen::Vector2d& p) -> Eigen::Vector2d {
    const Eigen::Vector2d q = p - centroid;
    return shift + turn * Eigen::Vector2d(-q.y(), q.x());
  };
  for (std::size_t m = 0; m < graph.modes.size(); ++m) {
    step->modes.segment<2>(static_cast<Eigen::Index>(2 * m)) -= motion_at(graph.modes[m]);
  }
  for (std::size_t r = 0; r < graph.runs.size(); ++r) {
    for (std::size_t i = 0; i < graph.runs[r].poses.size(); ++i) {
      const Se2& T_map_vehicle = graph.runs[r].poses[i];
      auto xi = step->poses[r].segment<3>(static_cast<Eigen::Index>(3 * i));
      xi.head<2>() -= T_map_vehicle.Rotation().transpose() * motion_at(T_map_vehicle.translation());
      xi[2] -= turn;
    }
  }
}

// Moves everything rigidly so that the pose that fixes the frame is where it was.
void HoldFrame(const Se2& T_map_anchor, Graph* graph) {
  Se2& anchor = graph->runs[static_cast<std::size_t>(graph->anchor_run)].poses.front();
  const Se2 T_map_moved = T_map_anchor * anchor.Inverse();
  for (GraphRun& run : graph->runs) {
    for (Se2& pose : run.poses) pose = T_map_moved * pose;
  }
  for (Eigen::Vector2d& mode : graph->modes) mode = T_map_moved * mode;
  anchor = T_map_anchor;
}

// A step that is expected to lower the cost by a smaller share is near the minimum: the curvature
// of the loss leads on from there.
constexpr double kNearMinimum = 1e-2;

// Steps that go down by more than expected, as where outliers make up their minds, are followed by
// longer ones. No longer than that: in other directions it is too far.
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
    for (std::size_t r = 0; r < runs_.size(); ++r) {
      graph->runs[r].poses = runs_[r].poses;
      graph->runs[r].correction = runs_[r].correction;
      graph->runs[r].sensor_bias = runs_[r].sensor_bias;
    }
  }

 private:
  struct Run {
    std::vector<Se2> poses;
    Eigen::Vector3d correction;
    SensorBias sensor_bias;
  };
  std::vector<Run> runs_;
  std::vector<Eigen::Vector2d> modes_;
};

// Gauss-Newton steps until the cost stays.
class GaussNewton {
 public:
  /// @param near_minimum  The graph is to begin with; then, whether it is where this ends.
  GaussNewton(const SolverLimits& limits,
              bool* near_minimum,
              GraphElimination* elimination,
              Graph* graph,
              GraphSummary* summary)
      : limits_(limits),
        near_minimum_(*near_minimum),
        elimination_(*elimination),
        graph_(*graph),
        summary_(*summary),
        floats_(graph->priors.empty() && !graph->modes.empty()) {
    if (graph->open) open_chain_.emplace(*graph);
  }

  // The first linearization. False if a segment is not determined.
  bool Start() {
    if (!Linearize()) return false;
    summary_.initial_cost = summary_.final_cost = elimination_.cost();
    return true;
  }

  // False if a step is not determined or does not go down; the graph is then where it was before
  // that step.
  bool Run() {
    while (summary_.iterations < limits_.max_iterations && !summary_.converged) {
      std::optional<GraphStep> step = elimination_.SimilarStep();
      if (!step) return false;
      const double expected = elimination_.ExpectedDecrease();
      near_minimum_ = expected <= kNearMinimum * summary_.final_cost;
      if (!near_minimum_) length_ = 1.0;
      if (length_ > 1.0) step = Scaled(*std::move(step), length_);
      if (floats_ && !open_chain_) TakeOutRigidMotion(graph_, &*step);
      const GraphValues before(graph_);
      Move(*step);
      ++summary_.iterations;
      if (IsLast(expected) && Ends()) return true;
      if (!GoDown(before, *std::move(step))) return false;
      const double decrease = summary_.final_cost - elimination_.cost();
      length_ = NextLength(expected, decrease);
      summary_.converged = decrease <= limits_.cost_tolerance * elimination_.cost();
      summary_.final_cost = elimination_.cost();
    }
    return true;
  }

 private:
  bool Linearize() {
    return near_minimum_ ? elimination_.LinearizeNearMinimum() : elimination_.LinearizeSegments();
  }

  // Nothing is linearized after the last step.
  bool IsLast(double expected) const {
    return summary_.iterations == limits_.max_iterations ||
           expected <= limits_.cost_tolerance * summary_.final_cost;
  }

  bool Ends() {
    const double cost = elimination_.PresentCost();
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
    if (Linearize() && elimination_.cost() <= summary_.final_cost * (1.0 + kRounding)) return true;
    for (int i = 0; i < kMaxHalvings; ++i) {
      before.CopyTo(&graph_);
      step = Scaled(std::move(step), 0.5);
      Move(step);
      if (Linearize() && elimination_.cost() <= summary_.final_cost) return true;
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
  bool& near_minimum_;
  GraphElimination& elimination_;
  Graph& graph_;
  GraphSummary& summary_;
  bool floats_;
  std::optional<OpenChain> open_chain_;
  double length_ = 1.0;
};

constexpr double kFirstDamping = 1e-3;

// Levenberg and Marquardt, from where steps of Gauss-Newton do not go down: until the cost stays.
// Where no step goes down however short, that is a minimum up to rounding.
void DampedGaussNewton(const SolverLimits& limits,
                       GraphElimination* elimination,
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
    std::optional<GraphStep> step;
    if (elimination->LinearizeSegments(damping)) step = elimination->SimilarStep();
    ++summary->iterations;
    if (!step) {
      damping *= kFactor;
      continue;
    }
    const GraphValues before(*graph);
    Apply(*step, graph);
    if (!elimination->LinearizeSegments() || elimination->cost() > summary->final_cost) {
      before.CopyTo(graph);
      damping *= kFactor;
      continue;
    }
    summary->converged =
        summary->final_cost - elimination->cost() <= limits.cost_tolerance * elimination->cost();
    summary->final_cost = elimination->cost();
    damping /= kFactor;
  }
}

}  // namespace

GraphSolver::GraphSolver() = default;
GraphSolver::~GraphSolver() = default;

std::unique_ptr<RestSystem> GraphSolver::TakeRest() { return std::move(rest_); }

void GraphSolver::KeepRest(std::unique_ptr<RestSystem> rest) { rest_ = std::move(rest); }

GraphSummary GraphSolver::Solve(const SolverLimits& limits, Graph* graph) {
  if (graph->solver == SolverKind::kCeres) return SolveGraphByCeres(limits, graph);
  GraphElimination elimination(*graph, std::move(rest_));
  GraphSummary summary;
  const Se2 T_map_anchor = graph->runs[static_cast<std::size_t>(graph->anchor_run)].poses.front();
  GaussNewton gauss_newton(limits, &near_minimum_, &elimination, graph, &summary);
  if (!gauss_newton.Start()) {
    // What damping does not determine is in no finite numbers, of which Ceres would write pages.
    if (!elimination.LinearizeSegments(kFirstDamping)) {
      summary.initial_cost = summary.final_cost = std::numeric_limits<double>::infinity();
      return summary;
    }
    return SolveGraphByCeres(limits, graph);
  }
  if (!gauss_newton.Run()) DampedGaussNewton(limits, &elimination, graph, &summary);
  if (graph->priors.empty()) HoldFrame(T_map_anchor, graph);
  rest_ = elimination.TakeRest();
  return summary;
}

GraphSummary SolveGraph(const SolverLimits& limits, Graph* graph) {
  return GraphSolver().Solve(limits, graph);
}

}  // namespace shiftmap
