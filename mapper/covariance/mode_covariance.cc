// SPDX-License-Identifier: Apache-2.0
#include "mapper/covariance/mode_covariance.h"

#include <Eigen/LU>
#include <algorithm>
#include <memory>
#include <random>
#include <utility>

#include "mapper/covariance/gauge.h"
#include "mapper/rows.h"
#include "proto/core/check.h"

namespace shiftmap {
namespace {

// Samples that bound the covariance of differences.
constexpr int kCovarianceSamples = 32;

using Modes = std::vector<ModeIndex>;
using Positions = IndexedVector<ModeIndex, Eigen::Vector2d>;

// Cuts [begin, end) of `modes` at the median of the longer side until no part is too large.
void Cut(const Positions& positions,
         int size,
         Modes::iterator begin,
         Modes::iterator end,
         std::vector<Modes>* tiles) {
  if (end - begin <= size) {
    tiles->emplace_back(begin, end);
    std::sort(tiles->back().begin(), tiles->back().end());
    return;
  }
  Eigen::Vector2d low = positions[*begin];
  Eigen::Vector2d high = low;
  for (auto it = begin; it != end; ++it) {
    low = low.cwiseMin(positions[*it]);
    high = high.cwiseMax(positions[*it]);
  }
  const Eigen::Index axis = high.x() - low.x() >= high.y() - low.y() ? 0 : 1;
  const auto middle = begin + (end - begin) / 2;
  std::nth_element(begin, middle, end, [&](ModeIndex a, ModeIndex b) {
    const double at_a = positions[a][axis];
    const double at_b = positions[b][axis];
    return at_a != at_b ? at_a < at_b : a < b;
  });
  Cut(positions, size, begin, middle, tiles);
  Cut(positions, size, middle, end, tiles);
}

STransformation MakeSTransformation(const Graph& graph, const GraphPosterior& posterior) {
  Eigen::MatrixXd G = GaugeDirections(graph.modes);
  const Eigen::MatrixXd PG = posterior.ModeCovarianceTimes(G);
  return {std::move(G), PG};
}

bool IsTiled(const Graph& graph) { return std::ssize(graph.modes) > kMaxJointModes; }

JointCovariance TiledCovariance(const Graph& graph,
                                const GraphPosterior& posterior,
                                double sd_scale,
                                const Eigen::MatrixXd& distortion,
                                const MapDisagreement& disagreement) {
  const std::vector<Modes> tiles = TileModes(graph.modes, kTileModes);
  IndexedVector<ModeIndex, std::size_t> tile_of(graph.modes.size());
  for (std::size_t t = 0; t < tiles.size(); ++t) {
    for (const ModeIndex mode : tiles[t]) tile_of[mode] = t;
  }
  const STransformation change = MakeSTransformation(graph, posterior);
  Eigen::MatrixXd root(2 * graph.modes.end_index(), 1 + distortion.cols());
  root.col(0) = sd_scale * OffsetsFromCentroid(graph.modes);
  if (distortion.cols() > 0) {
    root.rightCols(distortion.cols()) = distortion - change.G * (change.G.transpose() * distortion);
  }
  IndexedVector<ModeIndex, Eigen::Matrix2d> diagonal(graph.modes.size());
  std::vector<JointCovariance::CrossBlock> cross;
  const auto add_block = [&](ModeIndex a, ModeIndex b, const Eigen::Matrix2d& cov_a_b) {
    if (tile_of[a] != tile_of[b]) return;
    Eigen::Matrix2d block = ReferBlock(change, a, b, cov_a_b);
    block.noalias() += root.middleRows<2>(2 * a) * root.middleRows<2>(2 * b).transpose();
    if (a == b) {
      diagonal[a] = block;
    } else if (a < b) {
      cross.push_back({a.value(), b.value(), block});
    } else {
      cross.push_back({b.value(), a.value(), block.transpose()});
    }
  };
  posterior.VisitModeCovariance(add_block);
  for (const auto& [mode, of_mode] : disagreement.of_modes) diagonal[mode] += of_mode;
  return JointCovariance(std::move(diagonal), std::move(cross));
}

// Of all modes.
Eigen::MatrixXd PriorInformation(const Graph& graph) {
  const Eigen::Index rows = 2 * graph.modes.end_index();
  Eigen::MatrixXd information = Eigen::MatrixXd::Zero(rows, rows);
  for (const GraphPrior& prior : graph.priors) {
    const std::vector<Eigen::Index> at = RowsOf(prior.modes);
    information(at, at) += prior.information;
  }
  return information;
}

}  // namespace

std::optional<ModeDifferences> ModeDifferences::Of(const Graph& graph, GraphSolver* solver) {
  ModeDifferences result(solver->Linearize(graph));
  if (!result.posterior_) return std::nullopt;
  // Few differences cost less than the samples that would spare them.
  if (IsTiled(graph)) {
    std::mt19937_64 random(1);
    result.samples_ = result.posterior_->DrawModes(kCovarianceSamples, random);
  }
  return result;
}

Eigen::Matrix2d ModeDifferences::Covariance(ModeIndex a, ModeIndex b) const {
  return posterior_->ModeDifferenceCovariance(a, b);
}

Eigen::Matrix2d ModeDifferences::SampledCovariance(ModeIndex a, ModeIndex b, double factor) const {
  constexpr double kInfinite = 1e12;
  if (samples_.cols() == 0) {
    return Eigen::Matrix2d::Identity() * (factor < 1.0 ? 0.0 : kInfinite);
  }
  const auto differences = samples_.middleRows<2>(2 * a) - samples_.middleRows<2>(2 * b);
  return differences * differences.transpose() * (factor / static_cast<double>(samples_.cols()));
}

std::vector<Modes> TileModes(const Positions& positions, int size) {
  SHIFTMAP_CHECK(size > 0, "tiles of {} modes", size);
  Modes modes;
  for (const ModeIndex mode : positions.indices()) modes.push_back(mode);
  std::vector<Modes> tiles;
  if (!modes.empty()) Cut(positions, size, modes.begin(), modes.end(), &tiles);
  return tiles;
}

std::unique_ptr<GraphPosterior> LinearizeForMap(const Graph& graph) {
  return LinearizeGraph(graph,
                        IsTiled(graph) ? TileModes(graph.modes, kTileModes) : std::vector<Modes>());
}

void AddDistortions(const Eigen::MatrixXd& root, Eigen::MatrixXd* covariance) {
  if (root.cols() > 0) covariance->noalias() += root * root.transpose();
}

JointCovariance MapCovariance(const Graph& graph,
                              const GraphPosterior& posterior,
                              double sd_scale,
                              const Eigen::MatrixXd& distortion,
                              const MapDisagreement& disagreement) {
  if (IsTiled(graph)) return TiledCovariance(graph, posterior, sd_scale, distortion, disagreement);
  Eigen::MatrixXd P = posterior.ModeCovariance();
  if (disagreement.factor > 1.0) {
    P += (disagreement.factor - 1.0) * (P - P * PriorInformation(graph) * P);
  }
  AddDistortions(distortion, &P);
  Eigen::MatrixXd cov =
      AddScaleUncertainty(graph.modes, sd_scale, ReferToPositions(graph.modes, std::move(P)));
  for (const auto& [mode, of_mode] : disagreement.of_modes) {
    cov.block<2, 2>(2 * mode, 2 * mode) += of_mode;
  }
  return JointCovariance::FromDense(cov);
}

bool IsDetermined(const JointCovariance& covariance) {
  constexpr double kMaxVariance = 1e10;  // [m²]
  for (int mode = 0; mode < covariance.size(); ++mode) {
    const Eigen::Matrix2d block = covariance.Block(mode, mode);
    if (!(block.trace() < kMaxVariance && block(0, 0) > 0.0 && block.determinant() > 0.0)) {
      return false;
    }
  }
  return true;
}

}  // namespace shiftmap
