// SPDX-License-Identifier: Apache-2.0
#include "mapper/run_maps/variance_factor.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <random>
#include <vector>

#include "mapper/covariance/gauge.h"

namespace shiftmap {
namespace {

// Ten to sixty give about the same factor.
constexpr int kBlocks = 20;

// The mean over draws is of kBlocks terms each.
constexpr int kDraws = 4;

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

std::optional<ShapeCovariance> ShapeCovariance::Of(const Graph& graph) {
  ShapeCovariance shape;
  shape.posterior_ = LinearizeGraph(graph);
  if (!shape.posterior_) return std::nullopt;
  shape.G_.resize(2 * graph.modes.end_index(), 4);
  shape.G_ << GaugeDirections(graph.modes), OffsetsFromCentroid(graph.modes).normalized();
  Eigen::MatrixXd covariance = shape.posterior_->ModeCovariance();
  const STransformation change(shape.G_, covariance * shape.G_);
  covariance -= shape.G_ * change.W.transpose() + change.W * shape.G_.transpose();
  shape.llt_.compute(covariance + shape.G_ * shape.G_.transpose());
  if (shape.llt_.info() != Eigen::Success) return std::nullopt;
  return shape;
}

double VarianceFactor(const Graph& graph, const ShapeCovariance& shape, std::uint64_t seed) {
  const FrameBlocks blocks = StretchesOf(graph);
  const auto sum_of_squares = [&](const GraphResiduals& residuals) {
    return shape.Whiten(shape.posterior().ModeStepsByBlock(residuals, blocks, kBlocks))
        .squaredNorm();
  };
  std::mt19937_64 random(seed);
  Eigen::Array<double, kDraws, 1> drawn;
  const std::vector<GraphResiduals> left = shape.posterior().DrawFitResiduals(kDraws, random);
  for (int k = 0; k < kDraws; ++k) drawn[k] = sum_of_squares(left[static_cast<std::size_t>(k)]);
  const double expected = drawn.mean();
  const double excess = sum_of_squares(PresentResiduals(graph)) / expected - 1.0;
  if (!std::isfinite(excess)) return kUnknown;
  if (excess <= 0.0) return 1.0;
  // What would be seen of white noise is subtracted: else noise would count as an excess.
  const double chance = (drawn / expected - 1.0).square().sum() / (kDraws - 1);
  return 1.0 + std::max(0.0, excess - chance / excess);
}

double VarianceFactor(const MapperOptions& options, const BuildState& build) {
  BuildState own = build;
  const Graph graph = MakeGraph(options, &own);
  if (graph.modes.size() < ShapeCovariance::kMinModes) return 1.0;
  const std::optional<ShapeCovariance> shape = ShapeCovariance::Of(graph);
  return shape ? VarianceFactor(graph, *shape, options.seed) : kUnknown;
}

}  // namespace shiftmap
