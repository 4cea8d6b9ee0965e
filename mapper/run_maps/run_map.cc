// SPDX-License-Identifier: Apache-2.0
#include "mapper/run_maps/run_map.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "mapper/calibration/distortion_calibration.h"
#include "mapper/covariance/gauge.h"
#include "mapper/covariance/mode_covariance.h"
#include "mapper/graph/graph.h"
#include "mapper/graph/graph_posterior.h"
#include "mapstore/geometry/covariance.h"

namespace shiftmap {

double WorstSd(const RunMap& run_map) {
  double worst = 0.0;
  for (const AlignmentPoint& point : run_map.points) {
    worst = std::max(worst, std::sqrt(0.5 * point.cov.trace()));
  }
  return worst;
}

bool IsStiff(const RunMap& run_map, const DeformationOptions& options) {
  return WorstSd(run_map) <= options.stiff_sd_m;
}

namespace {

// As RunMap::covariance.
Eigen::MatrixXd CovarianceOf(const Graph& graph,
                             const GraphPosterior& posterior,
                             const BuildState& build) {
  Eigen::MatrixXd covariance = posterior.ModeCovariance();
  AddDistortions(build.distortion_root, &covariance);
  return ReferToPositions(graph.modes, std::move(covariance));
}

RunMap WithCovariance(BuildState build, Eigen::MatrixXd covariance) {
  RunMap run_map{std::move(build), {}, std::move(covariance)};
  for (const GroupIndex group : run_map.build.modes.indices()) {
    for (const BuildMode& mode : run_map.build.modes[group]) {
      const Eigen::Index at = 2 * run_map.points.end_index();
      run_map.points.push_back(
          {group, mode.p_map_landmark, run_map.covariance.block<2, 2>(at, at)});
    }
  }
  return run_map;
}

}  // namespace

std::optional<Eigen::MatrixXd> RunMapCovariance(const MapperOptions& options, BuildState* build) {
  const Graph graph = MakeGraph(options, build);
  const std::unique_ptr<GraphPosterior> posterior = LinearizeGraph(graph);
  if (!posterior) return std::nullopt;
  return CovarianceOf(graph, *posterior, *build);
}

std::optional<Eigen::MatrixXd> CovarianceOfModes(const MapperOptions& options,
                                                 const std::vector<ModeIndex>& modes,
                                                 BuildState* build) {
  const Graph graph = MakeGraph(options, build);
  const std::unique_ptr<GraphPosterior> posterior = LinearizeGraph(graph);
  if (!posterior) return std::nullopt;
  Eigen::MatrixXd chosen =
      Eigen::MatrixXd::Zero(2 * graph.modes.end_index(), 2 * std::ssize(modes));
  std::vector<Eigen::Vector2d> positions;
  for (std::size_t i = 0; i < modes.size(); ++i) {
    chosen.block<2, 2>(2 * modes[i], static_cast<Eigen::Index>(2 * i)).setIdentity();
    positions.push_back(graph.modes[modes[i]]);
  }
  Eigen::MatrixXd covariance =
      Symmetrized(chosen.transpose() * posterior->ModeCovarianceTimes(chosen));
  if (build->distortion_root.cols() > 0) {
    AddDistortions(chosen.transpose() * build->distortion_root, &covariance);
  }
  return ReferToPositions(positions, std::move(covariance));
}

std::optional<RunMap> MakeRunMap(const MapperOptions& options, BuildState build) {
  std::optional<Eigen::MatrixXd> covariance = RunMapCovariance(options, &build);
  if (!covariance) return std::nullopt;
  return WithCovariance(std::move(build), *std::move(covariance));
}

std::optional<RunMap> MakeUndistortedRunMap(const MapperOptions& options, BuildState build) {
  GraphSolver solver;
  {
    const Graph graph = SolveContinuous(options, &build, &solver);
    const std::unique_ptr<GraphPosterior> posterior = solver.Linearize(graph);
    if (!posterior) return std::nullopt;
    Eigen::MatrixXd covariance = CovarianceOf(graph, *posterior, build);
    RunMap run_map = WithCovariance(std::move(build), std::move(covariance));
    const bool undistorted = IsStiff(run_map, options.deformation) &&
                             EstimateDistortions(options, graph, *posterior, &run_map.build);
    if (!undistorted) return run_map;
    build = std::move(run_map.build);
  }
  SolveContinuous(options, &build, &solver);
  return MakeRunMap(options, std::move(build));
}

}  // namespace shiftmap
