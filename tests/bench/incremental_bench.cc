// SPDX-License-Identifier: Apache-2.0
//
// Time of a step of the incremental mapper after a log of so many frames: in a window of 40 s it
// does not depend on the length of the log, over the whole history it does.
#include <benchmark/benchmark.h>

#include <Eigen/Core>
#include <cmath>
#include <limits>
#include <random>
#include <utility>
#include <vector>

#include "tools/experiment/incremental/incremental_mapper.h"

namespace shiftmap {
namespace {

constexpr int kLandmarks = 16;
constexpr double kFramePeriodSeconds = 0.4;
constexpr double kRangeSd = 0.1;
constexpr double kBearingSd = 0.02;

Eigen::Vector2d Place(int landmark) {
  const double angle = 2.0 * M_PI * landmark / kLandmarks;
  return {8.0 * std::cos(angle), 8.0 * std::sin(angle)};
}

// A vehicle that drives circles and sees what is in front of it, without end.
class Drive {
 public:
  const Se2& T_map_vehicle() const { return T_map_vehicle_; }

  IncrementalFrame Next() {
    IncrementalFrame frame;
    frame.stamp = StampFromSeconds(kFramePeriodSeconds * count_++);
    frame.motion.T_begin_end = Se2::Exp({0.2, 0.0, 0.04});
    frame.motion.cov = Eigen::Vector3d(1e-4, 1e-4, 1e-5).asDiagonal();
    if (count_ > 1) {
      T_map_vehicle_ = T_map_vehicle_ * frame.motion.T_begin_end *
                       Se2::Exp({Draw(0.01), Draw(0.01), Draw(0.003)});
    }
    for (int landmark = 0; landmark < kLandmarks; ++landmark) {
      const Eigen::Vector2d q = T_map_vehicle_.Inverse() * Place(landmark);
      const double bearing_rad = std::atan2(q.y(), q.x());
      if (q.norm() > 5.0 || std::abs(bearing_rad) > 0.7) continue;
      Observation seen;
      seen.z = {q.norm() + Draw(kRangeSd), bearing_rad + Draw(kBearingSd)};
      frame.observations.push_back({landmark, seen});
    }
    return frame;
  }

 private:
  double Draw(double sd) { return sd * normal_(random_); }

  Se2 T_map_vehicle_ = Se2(0.0, -5.0, 0.0);
  int count_ = 0;
  std::mt19937_64 random_{1};
  std::normal_distribution<double> normal_;
};

IncrementalPrior Survey() {
  IncrementalPrior prior;
  prior.groups = kLandmarks;
  prior.mean.resize(2 * kLandmarks);
  for (int landmark = 0; landmark < kLandmarks; ++landmark) {
    prior.group.push_back(landmark);
    prior.mean.segment<2>(2 * landmark) = Place(landmark);
  }
  prior.cov = Eigen::MatrixXd::Identity(2 * kLandmarks, 2 * kLandmarks) * 0.0025;
  return prior;
}

void Step(benchmark::State& state, double window_s) {
  IncrementalOptions options;
  options.window_s = window_s;
  options.sensor.sd_range_m = kRangeSd;
  options.sensor.sd_bearing_rad = kBearingSd;
  Drive drive;
  const PoseWithCovariance start{drive.T_map_vehicle(), Eigen::Matrix3d::Identity() * 1e-4};
  StatusOr<IncrementalMapper> mapper = IncrementalMapper::Create(options, Survey(), start);
  for (int i = 0; i < state.range(0); ++i) (void)mapper->AddFrame(drive.Next());
  for (auto _ : state) {
    state.PauseTiming();
    const IncrementalFrame frame = drive.Next();
    state.ResumeTiming();
    benchmark::DoNotOptimize(mapper->AddFrame(frame));
  }
  state.counters["window_frames"] = static_cast<double>(mapper->window().frames.size());
}

void BM_StepInWindow(benchmark::State& state) { Step(state, 40.0); }
BENCHMARK(BM_StepInWindow)->Arg(200)->Arg(1000)->Arg(5000)->Iterations(200);

void BM_StepOverHistory(benchmark::State& state) {
  Step(state, std::numeric_limits<double>::infinity());
}
BENCHMARK(BM_StepOverHistory)->Arg(200)->Arg(1000)->Iterations(200);

}  // namespace
}  // namespace shiftmap
