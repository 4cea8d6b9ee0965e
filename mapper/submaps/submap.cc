// SPDX-License-Identifier: Apache-2.0
#include "mapper/submaps/submap.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "mapper/covariance/datum.h"
#include "mapper/graph/graph.h"
#include "mapper/graph/graph_posterior.h"
#include "mapstore/geometry/covariance.h"

namespace shiftmap {

double WorstSd(const Submap& submap) {
  double worst = 0.0;
  for (const AlignmentPoint& point : submap.points) {
    worst = std::max(worst, std::sqrt(0.5 * point.cov.trace()));
  }
  return worst;
}

bool IsStiff(const Submap& submap) {
  constexpr double kStiffSd = 0.15;  // [m]
  return WorstSd(submap) <= kStiffSd;
}

std::optional<Eigen::MatrixXd> SubmapCovariance(const MapperOptions& options, MapProblem* problem) {
  const Graph graph = MakeGraph(options, problem);
  std::optional<Eigen::MatrixXd> covariance = ComputeModeCovariance(graph);
  if (!covariance) return std::nullopt;
  return ReferToPositions(graph.modes, *std::move(covariance));
}

std::optional<Eigen::MatrixXd> CovarianceOfModes(const MapperOptions& options,
                                                 const std::vector<int>& modes,
                                                 MapProblem* problem) {
  const Graph graph = MakeGraph(options, problem);
  const std::unique_ptr<GraphPosterior> posterior = LinearizeGraph(graph);
  if (!posterior) return std::nullopt;
  const auto columns = static_cast<Eigen::Index>(2 * modes.size());
  Eigen::MatrixXd chosen =
      Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(2 * graph.modes.size()), columns);
  std::vector<Eigen::Vector2d> positions;
  for (std::size_t i = 0; i < modes.size(); ++i) {
    chosen.block<2, 2>(Eigen::Index{2} * modes[i], static_cast<Eigen::Index>(2 * i)).setIdentity();
    positions.push_back(graph.modes[static_cast<std::size_t>(modes[i])]);
  }
  const Eigen::MatrixXd covariance = chosen.transpose() * posterior->ModeCovarianceTimes(chosen);
  return ReferToPositions(positions, Symmetrized(covariance));
}

std::optional<Submap> MakeSubmap(const MapperOptions& options, MapProblem problem) {
  Submap submap{std::move(problem), {}, {}};
  std::optional<Eigen::MatrixXd> covariance = SubmapCovariance(options, &submap.problem);
  if (!covariance) return std::nullopt;
  submap.covariance = *std::move(covariance);
  for (std::size_t group = 0; group < submap.problem.modes.size(); ++group) {
    for (const BuildMode& mode : submap.problem.modes[group]) {
      const auto at = static_cast<Eigen::Index>(2 * submap.points.size());
      submap.points.push_back(
          {static_cast<int>(group), mode.p_map_landmark, submap.covariance.block<2, 2>(at, at)});
    }
  }
  return submap;
}

}  // namespace shiftmap
