// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <optional>
#include <random>
#include <utility>

#include "mapper/graph/elimination.h"
#include "mapper/graph/graph.h"
#include "mapstore/geometry/covariance.h"
#include "proto/core/check.h"

namespace shiftmap {
namespace {

// Outliers say nothing about the noise of the rest: an observation beyond this is not counted.
constexpr double kInlierProbability = 0.999;

constexpr char kNotDetermined[] = "the graph does not determine its poses and modes";

Eigen::Vector3d PoseStep(const GraphStep& step, std::size_t run, std::size_t frame) {
  return step.poses[run].segment<3>(static_cast<Eigen::Index>(3 * frame));
}

// Adds the residuals of motions: what they are, less what the fit explains of their variance.
void CountMotions(const Graph& graph,
                  const GraphElimination& elimination,
                  const std::vector<GraphStep>& draws,
                  std::vector<ResidualStatistics>* statistics) {
  const auto count = static_cast<double>(draws.size());
  for (std::size_t r = 0; r < graph.runs.size(); ++r) {
    const GraphRun& run = graph.runs[r];
    ResidualStatistics& sums = (*statistics)[r];
    for (std::size_t i = 0; i < run.motions.size(); ++i) {
      const MotionResidual::Linear linear = elimination.motions()[r][i].At(
          run.poses[i], run.poses[i + 1], run.correction, run.sensor_bias[kLogRangeScale]);
      Eigen::Array3d explained = Eigen::Array3d::Zero();
      for (const GraphStep& draw : draws) {
        explained += (linear.J_i * PoseStep(draw, r, i) + linear.J_j * PoseStep(draw, r, i + 1) +
                      linear.J_calibration * draw.calibrations[r].head<4>())
                         .array()
                         .square();
      }
      const Eigen::Array3d squares = linear.r.array().square();
      const Eigen::Array3d redundancy = 1.0 - explained / count;
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
                       const std::vector<GraphStep>& draws,
                       std::vector<ResidualStatistics>* statistics) {
  const double gate = ChiSquareQuantile(kInlierProbability, 2);
  const auto count = static_cast<double>(draws.size());
  for (std::size_t i = 0; i < graph.observations.size(); ++i) {
    const GraphObservation& item = graph.observations[i];
    const auto r = static_cast<std::size_t>(item.run);
    const auto frame = static_cast<std::size_t>(item.frame);
    const GraphRun& run = graph.runs[r];
    const ObservationResidual::Linear linear = elimination.observations()[i].At(
        run.poses[frame], graph.modes[static_cast<std::size_t>(item.mode)], run.sensor_bias);
    if (linear.r.squaredNorm() > gate) continue;
    Eigen::Array2d explained = Eigen::Array2d::Zero();
    for (const GraphStep& draw : draws) {
      explained += (linear.J_pose * PoseStep(draw, r, frame) +
                    linear.J_landmark * draw.modes.segment<2>(Eigen::Index{2} * item.mode) +
                    linear.J_bias * draw.calibrations[r].tail<3>())
                       .array()
                       .square();
    }
    ResidualStatistics& sums = (*statistics)[r];
    // Residuals are the noise less what the fit made of it, which is by the loss' curvature.
    const double weight = elimination.loss().Curvature(linear.r.squaredNorm());
    const bool cartesian = item.observation.kind == Observation::Kind::kCartesian;
    for (const int row : {0, 1}) {
      const auto kind = cartesian  ? ResidualStatistics::kPosition
                        : row == 0 ? ResidualStatistics::kRange
                                   : ResidualStatistics::kBearing;
      sums.sum_of_squares[kind] += linear.r[row] * linear.r[row];
      sums.count[kind] += 1.0;
      sums.redundancy[kind] += 1.0 - weight * explained[row] / count;
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
  const std::vector<GraphStep> draws = elimination.Draws(samples, random);
  std::vector<ResidualStatistics> statistics(graph.runs.size());
  CountMotions(graph, elimination, draws, &statistics);
  CountObservations(graph, elimination, draws, &statistics);
  return statistics;
}

std::vector<ResidualStatistics> ComputeRunStatistics(const Graph& graph,
                                                     int samples,
                                                     std::uint64_t seed) {
  GraphElimination elimination(graph);
  SHIFTMAP_CHECK(elimination.Linearize(), kNotDetermined);
  return ComputeRunStatistics(graph, elimination, samples, seed);
}

}  // namespace shiftmap
