// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <optional>
#include <random>

#include "mapper/graph/elimination.h"
#include "mapper/graph/graph.h"
#include "mapstore/geometry/covariance.h"
#include "proto/core/check.h"

namespace shiftmap {
namespace {

// Outliers say nothing about the noise of the rest: an observation beyond this is not counted.
constexpr double kInlierProbability = 0.999;

// Adds the residuals of motions, and what the fit leaves of noise on them.
void CountMotions(const Graph& graph,
                  const GraphElimination& elimination,
                  const std::vector<GraphResiduals>& left,
                  std::vector<ResidualStatistics>* statistics) {
  const auto count = static_cast<double>(left.size());
  for (std::size_t r = 0; r < graph.runs.size(); ++r) {
    const GraphRun& run = graph.runs[r];
    ResidualStatistics& sums = (*statistics)[r];
    for (std::size_t i = 0; i < run.motions.size(); ++i) {
      const MotionResidual::Linear linear = elimination.motions()[r][i].At(
          run.poses[i], run.poses[i + 1], run.correction, run.sensor_bias[kLogRangeScale]);
      Eigen::Array3d redundancy = Eigen::Array3d::Zero();
      for (const GraphResiduals& of_draw : left) {
        redundancy += of_draw.motions[r].col(static_cast<Eigen::Index>(i)).array().square() / count;
      }
      const Eigen::Array3d squares = linear.r.array().square();
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
                       const GraphElimination& elimination,
                       const std::vector<GraphResiduals>& left,
                       std::vector<ResidualStatistics>* statistics) {
  const double gate = ChiSquareQuantile(kInlierProbability, 2);
  const auto count = static_cast<double>(left.size());
  for (std::size_t i = 0; i < graph.observations.size(); ++i) {
    const GraphObservation& item = graph.observations[i];
    const auto r = static_cast<std::size_t>(item.run);
    const auto frame = static_cast<std::size_t>(item.frame);
    const GraphRun& run = graph.runs[r];
    const ObservationResidual::Linear linear = elimination.observations()[i].At(
        run.poses[frame], graph.modes[static_cast<std::size_t>(item.mode)], run.sensor_bias);
    if (linear.r.squaredNorm() > gate) continue;
    Eigen::Array2d redundancy = Eigen::Array2d::Zero();
    for (const GraphResiduals& of_draw : left) {
      redundancy += of_draw.observations.col(static_cast<Eigen::Index>(i)).array().square() / count;
    }
    ResidualStatistics& sums = (*statistics)[r];
    const bool cartesian = item.observation.kind == Observation::Kind::kCartesian;
    for (const int row : {0, 1}) {
      const auto kind = cartesian  ? ResidualStatistics::kPosition
                        : row == 0 ? ResidualStatistics::kRange
                                   : ResidualStatistics::kBearing;
      sums.sum_of_squares[kind] += linear.r[row] * linear.r[row];
      sums.count[kind] += 1.0;
      sums.redundancy[kind] += redundancy[row];
    }
  }
}

}  // namespace

std::optional<Eigen::MatrixXd> ComputeModeCovariance(const Graph& graph) {
  GraphElimination elimination(graph);
  if (!elimination.Linearize()) return std::nullopt;
  return elimination.ModeCovariance();
}

std::vector<ResidualStatistics> ComputeRunStatistics(const Graph& graph,
                                                     const GraphElimination& elimination,
                                                     int samples,
                                                     std::uint64_t seed) {
  SHIFTMAP_CHECK(samples > 0, "{} samples", samples);
  std::mt19937_64 random(seed);
  const std::vector<GraphResiduals> left =
      elimination.Left(elimination.DrawResiduals(samples, random));
  std::vector<ResidualStatistics> statistics(graph.runs.size());
  CountMotions(graph, elimination, left, &statistics);
  CountObservations(graph, elimination, left, &statistics);
  return statistics;
}

std::optional<std::vector<ResidualStatistics>> ComputeRunStatistics(const Graph& graph,
                                                                    int samples,
                                                                    std::uint64_t seed,
                                                                    GraphSolver* solver) {
  GraphElimination elimination(graph, solver != nullptr ? solver->TakeRest() : nullptr);
  if (!elimination.LinearizeSimilar()) return std::nullopt;
  std::vector<ResidualStatistics> statistics =
      ComputeRunStatistics(graph, elimination, samples, seed);
  if (solver != nullptr) solver->KeepRest(elimination.TakeRest());
  return statistics;
}

}  // namespace shiftmap
