// SPDX-License-Identifier: Apache-2.0
#include "mapper/mode_covariance.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "mapper/datum.h"
#include "proto/core/check.h"

namespace shiftmap {
namespace {

// Modes whose joint covariance a large map has: what a vehicle uses at a time are fewer.
constexpr int kTileModes = 128;

constexpr char kNotDetermined[] = "the graph does not determine its modes";

using Modes = std::vector<int>;

// Cuts [begin, end) of `modes` at the median of the longer side until no part is too large.
void Cut(const std::vector<Eigen::Vector2d>& positions,
         int size,
         Modes::iterator begin,
         Modes::iterator end,
         std::vector<Modes>* tiles) {
  if (end - begin <= size) {
    tiles->emplace_back(begin, end);
    std::sort(tiles->back().begin(), tiles->back().end());
    return;
  }
  Eigen::Vector2d low = positions[static_cast<std::size_t>(*begin)];
  Eigen::Vector2d high = low;
  for (auto it = begin; it != end; ++it) {
    low = low.cwiseMin(positions[static_cast<std::size_t>(*it)]);
    high = high.cwiseMax(positions[static_cast<std::size_t>(*it)]);
  }
  const Eigen::Index axis = high.x() - low.x() >= high.y() - low.y() ? 0 : 1;
  const auto middle = begin + (end - begin) / 2;
  std::nth_element(begin, middle, end, [&](int a, int b) {
    const double at_a = positions[static_cast<std::size_t>(a)][axis];
    const double at_b = positions[static_cast<std::size_t>(b)][axis];
    return at_a != at_b ? at_a < at_b : a < b;
  });
  Cut(positions, size, begin, middle, tiles);
  Cut(positions, size, middle, end, tiles);
}

DatumChange MakeDatumChange(const Graph& graph, const GraphElimination& elimination) {
  Eigen::MatrixXd G = DatumDirections(graph.modes);
  const Eigen::MatrixXd PG = elimination.ModeCovarianceTimes(G);
  return {std::move(G), PG};
}

JointCovariance TiledCovariance(const Graph& graph, double sd_range_scale) {
  const std::vector<Modes> tiles = TileModes(graph.modes, kTileModes);
  std::vector<int> tile_of(graph.modes.size());
  for (std::size_t t = 0; t < tiles.size(); ++t) {
    for (const int mode : tiles[t]) {
      tile_of[static_cast<std::size_t>(mode)] = static_cast<int>(t);
    }
  }
  GraphElimination elimination(graph, tiles);
  SHIFTMAP_CHECK(elimination.Linearize(), kNotDetermined);
  const DatumChange change = MakeDatumChange(graph, elimination);
  const Eigen::Vector2d centroid = Centroid(graph.modes);
  std::vector<Eigen::Matrix2d> diagonal(graph.modes.size());
  std::vector<JointCovariance::CrossBlock> cross;
  elimination.VisitModeCovariance([&](int a, int b, const Eigen::Matrix2d& cov_a_b) {
    const auto i = static_cast<std::size_t>(a);
    const auto j = static_cast<std::size_t>(b);
    if (tile_of[i] != tile_of[j]) return;
    Eigen::Matrix2d block = change.Refer(a, b, cov_a_b);
    const Eigen::Vector2d q_a = sd_range_scale * (graph.modes[i] - centroid);
    const Eigen::Vector2d q_b = sd_range_scale * (graph.modes[j] - centroid);
    block.noalias() += q_a * q_b.transpose();
    if (a == b) {
      diagonal[i] = block;
    } else if (a < b) {
      cross.push_back({a, b, block});
    } else {
      cross.push_back({b, a, block.transpose()});
    }
  });
  return JointCovariance(std::move(diagonal), std::move(cross));
}

}  // namespace

ModeDifferences::ModeDifferences(const Graph& graph) {
  if (static_cast<int>(graph.modes.size()) <= kMaxJointModes) {
    joint_ = ComputeModeCovariance(graph);
    return;
  }
  graph_ = &graph;
  elimination_ = std::make_unique<GraphElimination>(graph);
  SHIFTMAP_CHECK(elimination_->Linearize(), kNotDetermined);
  const DatumChange change = MakeDatumChange(graph, *elimination_);
  traces_.resize(graph.modes.size());
  elimination_->VisitModeCovariance([&](int a, int b, const Eigen::Matrix2d& cov_a_b) {
    if (a == b) traces_[static_cast<std::size_t>(a)] = change.Refer(a, a, cov_a_b).trace();
  });
  // The third direction is a unit vector: a rotation by one radian is longer by the norm of all
  // offsets. Of P G, half is in W.
  const Eigen::Vector2d centroid = Centroid(graph.modes);
  double squared_offsets = 0.0;
  for (const Eigen::Vector2d& position : graph.modes) {
    squared_offsets += (position - centroid).squaredNorm();
  }
  rotation_variance_ = 2.0 * change.G.col(2).dot(change.W.col(2)) / squared_offsets;
}

Eigen::Matrix2d ModeDifferences::Covariance(int a, int b) const {
  const Eigen::Index i = Eigen::Index{2} * a;
  const Eigen::Index j = Eigen::Index{2} * b;
  if (graph_ == nullptr) {
    return joint_.block<2, 2>(i, i) + joint_.block<2, 2>(j, j) - joint_.block<2, 2>(i, j) -
           joint_.block<2, 2>(j, i);
  }
  Eigen::MatrixXd difference =
      Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(2 * graph_->modes.size()), 2);
  difference.middleRows<2>(i).setIdentity();
  difference.middleRows<2>(j) = -Eigen::Matrix2d::Identity();
  const Eigen::MatrixXd solved = elimination_->ModeCovarianceTimes(difference);
  return solved.middleRows<2>(i) - solved.middleRows<2>(j);
}

double ModeDifferences::MaxVariance(int a, int b) const {
  if (graph_ == nullptr) return std::numeric_limits<double>::infinity();
  const auto i = static_cast<std::size_t>(a);
  const auto j = static_cast<std::size_t>(b);
  const double squared = (graph_->modes[i] - graph_->modes[j]).squaredNorm();
  return 2.0 * (2.0 * traces_[i] + 2.0 * traces_[j] + squared * rotation_variance_);
}

std::vector<Modes> TileModes(const std::vector<Eigen::Vector2d>& positions, int size) {
  SHIFTMAP_CHECK(size > 0, "tiles of {} modes", size);
  Modes modes;
  for (std::size_t i = 0; i < positions.size(); ++i) modes.push_back(static_cast<int>(i));
  std::vector<Modes> tiles;
  if (!modes.empty()) Cut(positions, size, modes.begin(), modes.end(), &tiles);
  return tiles;
}

JointCovariance MapCovariance(const Graph& graph, double sd_range_scale) {
  if (static_cast<int>(graph.modes.size()) > kMaxJointModes) {
    return TiledCovariance(graph, sd_range_scale);
  }
  const Eigen::MatrixXd referred = ReferToPositions(graph.modes, ComputeModeCovariance(graph));
  return JointCovariance::FromDense(AddScaleUncertainty(graph.modes, sd_range_scale, referred));
}

}  // namespace shiftmap
