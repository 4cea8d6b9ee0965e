// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <memory>
#include <optional>
#include <random>

#include "mapper/graph/ceres_posterior.h"
#include "mapper/graph/graph.h"
#include "mapper/graph/graph_posterior.h"
#include "mapper/graph/residuals.h"
#include "mapper/graph/robust_loss.h"
#include "mapper/graph/schur_posterior.h"
#include "mapstore/geometry/covariance.h"
#include "proto/core/check.h"

namespace shiftmap {
namespace {

// Under the noise of the run, here and below, whatever its variance factor.
Eigen::Vector3d ResidualOf(const GraphRun& run, FrameIndex motion) {
  return MotionResidual(run.motions[motion])
      .At(run.poses[motion], run.poses[motion + 1], run.correction, run.sensor_bias[kLogRangeScale])
      .r;
}

Eigen::Vector2d ResidualOf(const Graph& graph, const GraphObservation& item) {
  const GraphRun& run = graph.runs[item.run];
  return ObservationResidual(item)
      .At(run.poses[item.frame], graph.modes[item.mode], run.sensor_bias)
      .r;
}

// Adds the residuals of motions, and what the fit leaves of noise on them.
void CountMotions(const Graph& graph,
                  const std::vector<GraphResiduals>& left,
                  RunStatistics* statistics) {
  const auto count = static_cast<double>(left.size());
  for (const RunIndex r : graph.runs.indices()) {
    const GraphRun& run = graph.runs[r];
    ResidualStatistics& sums = (*statistics)[r];
    for (const FrameIndex i : run.motions.indices()) {
      if (!TellsNoise(run.motions[i])) continue;
      const Eigen::Vector3d residual = ResidualOf(run, i);
      Eigen::Array3d redundancy = Eigen::Array3d::Zero();
      for (const GraphResiduals& of_draw : left) {
        redundancy += of_draw.motions[r].col(i.value()).array().square() / count;
      }
      const Eigen::Array3d squares = residual.array().square();
      sums.sum_of_squares[ResidualStatistics::kTranslation] += squares.head<2>().sum();
      sums.count[ResidualStatistics::kTranslation] += 2.0;
      sums.count[ResidualStatistics::kYaw] += 1.0;
      sums.redundancy[ResidualStatistics::kTranslation] += redundancy.head<2>().sum();
      sums.sum_of_squares[ResidualStatistics::kYaw] += squares[2];
      sums.redundancy[ResidualStatistics::kYaw] += redundancy[2];
    }
  }
}

void CountObservations(const Graph& graph,
                       const std::vector<GraphResiduals>& left,
                       RunStatistics* statistics) {
  const double gate = ChiSquareQuantile(kInlierProbability, 2);
  const auto count = static_cast<double>(left.size());
  for (const ObservationIndex i : graph.observations.indices()) {
    const GraphObservation& item = graph.observations[i];
    const Eigen::Vector2d residual = ResidualOf(graph, item);
    if (residual.squaredNorm() > gate) continue;
    Eigen::Array2d redundancy = Eigen::Array2d::Zero();
    for (const GraphResiduals& of_draw : left) {
      redundancy += of_draw.observations.col(i.value()).array().square() / count;
    }
    ResidualStatistics& sums = (*statistics)[item.run];
    const bool cartesian = item.observation.kind == Observation::Kind::kCartesian;
    for (const int row : {0, 1}) {
      const auto kind = cartesian  ? ResidualStatistics::kPosition
                        : row == 0 ? ResidualStatistics::kRange
                                   : ResidualStatistics::kBearing;
      sums.sum_of_squares[kind] += residual[row] * residual[row];
      sums.count[kind] += 1.0;
      sums.redundancy[kind] += redundancy[row];
    }
  }
}

}  // namespace

std::unique_ptr<GraphPosterior> LinearizeGraph(
    const Graph& graph, const std::vector<std::vector<ModeIndex>>& required_sets) {
  if (graph.solver == SolverKind::kCeres) return CeresPosterior::Of(graph, required_sets);
  std::unique_ptr<ReducedSystem> reduced;
  return SchurPosterior::Of(graph, required_sets, &reduced);
}

GraphResiduals PresentResiduals(const Graph& graph) {
  const IndexedVector<RunIndex, RobustLoss> losses = LossesOf(graph);
  GraphResiduals present;
  for (const GraphRun& run : graph.runs) {
    Eigen::Matrix3Xd& motions = present.motions.emplace_back(3, std::ssize(run.motions));
    for (const FrameIndex i : run.motions.indices()) {
      motions.col(i.value()) = ResidualOf(run, i) / std::sqrt(run.variance_factor);
    }
  }
  present.observations.resize(2, std::ssize(graph.observations));
  for (const ObservationIndex i : graph.observations.indices()) {
    const GraphObservation& item = graph.observations[i];
    const RobustLoss& loss = losses[item.run];
    const Eigen::Vector2d r = ResidualOf(graph, item);
    const double squared = r.squaredNorm();
    present.observations.col(i.value()) =
        loss.Slope(squared) / std::sqrt(loss.Curvature(squared)) * r;
  }
  return present;
}

RunStatistics ComputeRunStatistics(const Graph& graph,
                                   const GraphPosterior& posterior,
                                   int samples,
                                   std::uint64_t seed) {
  SHIFTMAP_CHECK(samples > 0, "{} samples", samples);
  std::mt19937_64 random(seed);
  const std::vector<GraphResiduals> left = posterior.DrawFitResiduals(samples, random);
  RunStatistics statistics(graph.runs.size());
  CountMotions(graph, left, &statistics);
  CountObservations(graph, left, &statistics);
  return statistics;
}

std::optional<RunStatistics> ComputeRunStatistics(const Graph& graph,
                                                  int samples,
                                                  std::uint64_t seed,
                                                  GraphSolver* solver) {
  const std::unique_ptr<GraphPosterior> posterior =
      solver != nullptr ? solver->Linearize(graph) : LinearizeGraph(graph);
  if (!posterior) return std::nullopt;
  return ComputeRunStatistics(graph, *posterior, samples, seed);
}

}  // namespace shiftmap
