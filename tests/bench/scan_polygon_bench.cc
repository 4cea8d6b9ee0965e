// SPDX-License-Identifier: Apache-2.0
//
// The field of view by a lidar's scan, for every landmark around: polygon and all probabilities, by
// beams and landmarks.
#include <benchmark/benchmark.h>

#include <cmath>
#include <numbers>
#include <random>
#include <vector>

#include "localizer/models/scan_polygon.h"

namespace shiftmap {
namespace {

void FieldOfViewOfAScan(benchmark::State& state) {
  const auto beams = static_cast<std::size_t>(state.range(0));
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  std::vector<Eigen::Vector2d> border;
  for (std::size_t i = 0; i < beams; ++i) {
    const double bearing =
        std::numbers::pi * (static_cast<double>(i) / static_cast<double>(beams - 1) - 0.5);
    const double range = 3.0 + 7.0 * uniform(random);
    border.emplace_back(range * std::cos(bearing), range * std::sin(bearing));
  }
  std::vector<Eigen::Vector2d> landmarks;
  for (int i = 0; i < state.range(1); ++i) {
    landmarks.emplace_back(10.0 * uniform(random), 16.0 * uniform(random) - 8.0);
  }
  const PoseWithCovariance pose{Se2(), Eigen::Vector3d(0.01, 0.01, 0.001).asDiagonal()};
  const Eigen::Matrix2d cov = 0.01 * Eigen::Matrix2d::Identity();
  const ScanPolygonOptions options;
  const ScanPolygonFieldOfView view(options);
  for (auto _ : state) {
    const ScanPolygon polygon(border, Se2(), false, options.grown_m);
    double sum = 0.0;
    for (const Eigen::Vector2d& landmark : landmarks) sum += view(polygon, pose, landmark, cov);
    benchmark::DoNotOptimize(sum);
  }
}
BENCHMARK(FieldOfViewOfAScan)
    ->Args({361, 20})
    ->Args({1081, 20})
    ->Args({361, 100})
    ->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace shiftmap
