// SPDX-License-Identifier: Apache-2.0
//
// The field of view by a lidar's scan, for every landmark around: polygon and all probabilities, by
// beams and landmarks.
#include <benchmark/benchmark.h>

#include <cstdint>
#include <numbers>
#include <random>
#include <vector>

#include "localizer/models/field_of_view.h"

namespace shiftmap {
namespace {

void FieldOfViewOfAScan(benchmark::State& state) {
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  LidarView lidar;
  lidar.counts = true;
  for (std::int64_t i = 0; i < state.range(0); ++i) {
    lidar.scan.ranges_m.push_back(static_cast<float>(3.0 + 7.0 * uniform(random)));
  }
  std::vector<Eigen::Vector2d> landmarks;
  for (int i = 0; i < state.range(1); ++i) {
    landmarks.emplace_back(10.0 * uniform(random), 16.0 * uniform(random) - 8.0);
  }
  const Eigen::Matrix2d cov = 0.02 * Eigen::Matrix2d::Identity();
  SensorCalibration sensor;
  sensor.max_range_m = 20.0;
  sensor.max_bearing_rad = std::numbers::pi;
  FieldOfView view(sensor);
  for (auto _ : state) {
    lidar.scan.stamp += Duration(1);  // Another scan: the polygon is made anew.
    view.Look(&lidar);
    double sum = 0.0;
    for (const Eigen::Vector2d& landmark : landmarks) sum += view.Probability(landmark, cov).sensor;
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
