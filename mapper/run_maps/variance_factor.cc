// SPDX-License-Identifier: Apache-2.0
#include "mapper/run_maps/variance_factor.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <random>
#include <vector>

#include "mapper/covariance/gauge.h"
#include "mapper/graph/graph_posterior.h"

namespace shiftmap {
namespace {

// Ten to sixty give about the same factor.
constexpr int kBlocks = 20;

// The mean over draws is of kBlocks terms each.
constexpr int kDraws = 8;

// Of a build that nothing is known of.
constexpr double kUnknown = 1e4;

// Stretches of time with about the same number of observations, runs one after the other.
FrameBlocks StretchesOf(const Graph& graph) {
  FrameBlocks observations;
  for (const GraphRun& run : graph.runs) observations.emplace_back(run.poses.size(), 0);
  for (const GraphObservation& item : graph.observations) {
    ++observations[item.run][item.frame];
  }
  const std::size_t count = std::max<std::size_t>(1, graph.observations.size());
  FrameBlocks blocks;
  std::size_t before = 0;
  for (const auto& of_run : observations) {
    auto& of_frames = blocks.emplace_back();
    for (const int of_frame : of_run) {
      const std::size_t block = kBlocks * before / count;
      of_frames.push_back(std::min(kBlocks - 1, static_cast<int>(block)));
      before += static_cast<std::size_t>(of_frame);
    }
  }
  return blocks;
}

}  // namespace

double VarianceFactor(const MapperOptions& options, const BuildState& build) {
  BuildState own = build;
  const Graph graph = MakeGraph(options, &own);
  if (graph.modes.size() <= 2) return 1.0;
  const std::unique_ptr<GraphPosterior> posterior = LinearizeGraph(graph);
  if (!posterior) return kUnknown;
  const Eigen::MatrixXd basis = ShapeDirections(graph.modes);
  const Eigen::LLT<Eigen::MatrixXd> llt(basis.transpose() * posterior->ModeCovariance() * basis);
  if (llt.info() != Eigen::Success) return kUnknown;
  const FrameBlocks blocks = StretchesOf(graph);
  const auto sum_of_squares = [&](const GraphResiduals& residuals) {
    const Eigen::MatrixXd steps =
        basis.transpose() * posterior->ModeStepsByBlock(residuals, blocks, kBlocks);
    return llt.matrixL().solve(steps).squaredNorm();
  };
  std::mt19937_64 random(options.seed);
  double expected = 0.0;
  for (const GraphResiduals& left : posterior->DrawFitResiduals(kDraws, random)) {
    expected += sum_of_squares(left) / kDraws;
  }
  const double factor = sum_of_squares(PresentResiduals(graph)) / expected;
  return std::isfinite(factor) ? std::max(1.0, factor) : kUnknown;
}

}  // namespace shiftmap
