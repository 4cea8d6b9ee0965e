// SPDX-License-Identifier: Apache-2.0
//
// The localizer's step on maps of up to 1,000 landmarks with three places each: 20 scans per second
// with ten observations, wrong places believed in at the start. By groups, leaves, and beams of a
// lidar that scans as often (0: there is none, and the field of view is the sector). Counters:
// quantiles of single steps in microseconds of processor time, leaves, and the start-up with that
// map.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <cmath>
#include <ctime>
#include <random>
#include <utility>
#include <vector>

#include "localizer/localizer.h"

namespace shiftmap {
namespace {

constexpr double kScanPeriod = 0.05;
constexpr double kSpeed = 0.5;
constexpr std::size_t kObservations = 10;
constexpr int kScans = 2000;

/// Landmarks on a strip along x, as dense whatever their number; the third place holds.
MapContent Strip(int groups) {
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> across(-6.0, 6.0);
  std::uniform_real_distribution<double> along(-1.5, 1.5);
  MapContent content;
  std::vector<Eigen::Matrix2d> marginals;
  for (int i = 0; i < groups; ++i) {
    LandmarkGroup group;
    group.signature = Signature(std::to_string(10000 + i));
    for (int number = 1; number <= 3; ++number) {
      Mode mode;
      mode.number = ModeNumber(number);
      mode.p_map_landmark = {0.5 * i + along(random), across(random)};
      mode.cov_p_map_landmark = Eigen::Matrix2d::Identity() * 0.0025;
      group.modes.push_back(mode);
      marginals.push_back(mode.cov_p_map_landmark);
    }
    group.chain = ModeChain::Uniform(3, 1e-6);
    group.probabilities = Eigen::Vector4d(0.02, 0.9, 0.04, 0.04);
    content.groups.push_back(group);
  }
  content.covariance = JointCovariance(marginals, {});
  content.calibration.sensor.max_range_m = 10.0;
  content.calibration.sensor.max_bearing_rad = 1.0;
  content.stamp = StampFromSeconds(1000.0);
  return content;
}

/// Between walls 6 m to the left and to the right, along the strip: many landmarks stand on them.
LidarScan BetweenWalls(Stamp stamp, std::int64_t beams) {
  constexpr double kWall = 6.0;
  constexpr double kFarthest = 30.0;
  LidarScan scan;
  scan.stamp = stamp;
  for (std::int64_t i = 0; i < beams; ++i) {
    const double bearing =
        scan.sensor.Bearing(static_cast<std::size_t>(i), static_cast<std::size_t>(beams));
    scan.ranges_m.push_back(
        static_cast<float>(std::min(kFarthest, kWall / std::abs(std::sin(bearing)))));
  }
  return scan;
}

std::vector<RunEvent> Drive(const MapContent& content, std::int64_t beams) {
  std::mt19937_64 random(2);
  std::normal_distribution<double> normal;
  const SensorCalibration& sensor = content.calibration.sensor;
  std::vector<RunEvent> events;
  for (int step = 0; step < kScans; ++step) {
    const Stamp stamp = StampFromSeconds(1000.0 + kScanPeriod * step);
    events.emplace_back(OdometrySample{stamp, kSpeed, 0.0});
    if (beams > 0) events.emplace_back(BetweenWalls(stamp, beams));
    const Se2 T_map_vehicle(5.0 + kSpeed * kScanPeriod * step, 0.0, 0.0);
    Scan scan;
    scan.stamp = stamp;
    for (const LandmarkGroup& group : content.groups) {
      if (scan.observations.size() == kObservations) break;
      const Eigen::Vector2d q = T_map_vehicle.Inverse() * group.modes[2].p_map_landmark;
      const Eigen::Vector2d z(q.norm(), std::atan2(q.y(), q.x()));
      const bool in_view =
          z.x() > 1.0 && z.x() < sensor.max_range_m && std::abs(z.y()) < sensor.max_bearing_rad;
      if (!in_view) continue;
      Observation observation;
      observation.signature = group.signature;
      observation.z = z + Eigen::Vector2d(sensor.sd_range_m * normal(random),
                                          sensor.sd_bearing_rad * normal(random));
      scan.observations.push_back(observation);
    }
    events.emplace_back(std::move(scan));
  }
  return events;
}

/// Processor time of this thread: what a busy machine takes away does not count.
double MicrosecondsUsed() {
  timespec used = {};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &used);
  return 1e6 * static_cast<double>(used.tv_sec) + 1e-3 * static_cast<double>(used.tv_nsec);
}

void BM_Step(benchmark::State& state) {
  const MapContent content = Strip(static_cast<int>(state.range(0)));
  const std::vector<RunEvent> events = Drive(content, state.range(2));
  LocalizerOptions options;
  if (state.range(2) > 0) options.hypotheses.field_of_view.model = FieldOfViewModel::kScanPolygon;
  options.hypotheses.max_leaves = static_cast<int>(state.range(1));
  options.initial_pose =
      PoseWithCovariance{Se2(5.0, 0.0, 0.0), Eigen::Vector3d(0.04, 0.04, 0.0025).asDiagonal()};
  std::vector<double> steps_us;
  double start_us = 0.0;
  int leaves_max = 0;
  for (auto _ : state) {
    state.PauseTiming();
    MapContent copy = content;
    const double start = MicrosecondsUsed();
    Localizer localizer(MapSnapshot("area", VersionNumber(1), "hash", std::move(copy)), options);
    state.ResumeTiming();
    for (const RunEvent& event : events) {
      const double begin = MicrosecondsUsed();
      benchmark::DoNotOptimize(localizer.Process(event).ok());
      if (!std::holds_alternative<Scan>(event)) continue;
      if (localizer.Statistics().scans == 1) {
        start_us =
            std::max(start_us, MicrosecondsUsed() - start);  // The first scan builds the bank.
      } else {
        steps_us.push_back(MicrosecondsUsed() - begin);
      }
    }
    leaves_max = localizer.Statistics().leaves_max;
  }
  std::sort(steps_us.begin(), steps_us.end());
  state.counters["p50_us"] = steps_us[steps_us.size() / 2];
  state.counters["p99_us"] = steps_us[steps_us.size() * 99 / 100];
  state.counters["max_us"] = steps_us.back();
  state.counters["start_us"] = start_us;
  state.counters["leaves_max"] = leaves_max;
}
BENCHMARK(BM_Step)
    ->Args({250, 8, 0})
    ->Args({1000, 8, 0})
    ->Args({1000, 48, 0})
    ->Args({1000, 8, 361})
    ->Args({1000, 48, 361})
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace shiftmap
