// SPDX-License-Identifier: Apache-2.0
#include "mapper/calibration/noise_calibration.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "mapper/graph/graph.h"
#include "mapstore/core/median.h"

namespace shiftmap {
namespace {

// A standard deviation may not change by more than this factor in one step.
constexpr double kMaxFactor = 4.0;

// Fewer degrees of freedom say nothing.
constexpr double kMinRedundancy = 20.0;

// Of sd, smaller is none. [m/√s], [rad/√s], [m], [rad]
constexpr double kMinOdometry = 1e-4;
constexpr double kMinPosition = 1e-3;
constexpr double kMinBearing = 1e-4;

// The factor by which to change a standard deviation σ. If every residual has the variance σ₀²
// sought plus a part m that the fit absorbs, r / n = σ² / (σ² + m), and σ₀² = σ² (1 + (s/r - 1)
// n/r) with s the sum of squares. If r residuals determine all, σ₀² = σ² s/r. Steps lie in between,
// with √(n/r).
double Factor(const ResidualStatistics& statistics, ResidualStatistics::Kind kind) {
  const double redundancy = statistics.redundancy[kind];
  if (redundancy < kMinRedundancy) return 1.0;
  const double ratio = std::max(1e-300, statistics.sum_of_squares[kind] / redundancy);
  const double gain = std::sqrt(std::max(1.0, statistics.count[kind] / redundancy));
  const double way = std::sqrt(1.0 + gain * (std::max(ratio, 1.0 / ratio) - 1.0));
  return std::clamp(ratio > 1.0 ? way : 1.0 / way, 1.0 / kMaxFactor, kMaxFactor);
}

class VarianceComponents {
 public:
  explicit VarianceComponents(BuildState* build) : problem_(build) {
    for (const auto& [name, runs] : RunsByVehicle(*build)) vehicles_.push_back(runs);
  }

  // One step of all. Returns the largest factor, 1 or more.
  double Step(const RunStatistics& statistics) {
    double largest = 1.0;
    const auto apply = [&](double factor, double least, double* sd) {
      *sd = std::max(least, *sd * factor);
      largest = std::max({largest, factor, 1.0 / factor});
    };
    ResidualStatistics all;
    for (const std::vector<RunIndex>& runs : vehicles_) {
      ResidualStatistics sum;
      for (const RunIndex run : runs) sum += statistics[run];
      all += sum;
      const double v = Factor(sum, ResidualStatistics::kTranslation);
      const double omega = Factor(sum, ResidualStatistics::kYaw);
      for (const RunIndex run : runs) {
        apply(v, kMinOdometry, &problem_->runs[run].odometry.noise_v);
        apply(omega, kMinOdometry, &problem_->runs[run].odometry.noise_omega);
      }
    }
    SensorCalibration& sensor = problem_->sensor;
    apply(Factor(all, ResidualStatistics::kRange), kMinPosition, &sensor.sd_range_m);
    apply(Factor(all, ResidualStatistics::kBearing), kMinBearing, &sensor.sd_bearing_rad);
    apply(Factor(all, ResidualStatistics::kPosition), kMinPosition, &sensor.sd_position_m);
    return largest;
  }

 private:
  BuildState* problem_;
  std::vector<std::vector<RunIndex>> vehicles_;  // Runs of each.
};

// Draws for the redundancy of residuals: many residuals share few.
int NoiseSamples(const Graph& graph) {
  constexpr std::size_t kResiduals = 10'000;
  constexpr std::size_t kLeast = 1;
  constexpr std::size_t kMost = 24;
  std::size_t residuals = 2 * graph.observations.size();
  for (const GraphRun& run : graph.runs) residuals += 3 * run.motions.size();
  return static_cast<int>(
      std::clamp(kResiduals / std::max<std::size_t>(residuals, 1), kLeast, kMost));
}

using Odometries = std::vector<OdometryCalibration*>;

// Changes the noise of each run of a vehicle, given it and the median of all.
template <typename Change>
void ChangeByMedian(const Odometries& odometries, const Change& change) {
  for (double OdometryCalibration::*noise :
       {&OdometryCalibration::noise_v, &OdometryCalibration::noise_omega}) {
    std::vector<double> values;
    for (const OdometryCalibration* odometry : odometries) values.push_back(odometry->*noise);
    const double median = Median(std::move(values));
    for (OdometryCalibration* odometry : odometries) {
      odometry->*noise = change(odometry->*noise, median);
    }
  }
}

}  // namespace

void PoolNoiseByVehicle(BuildState* build) {
  for (const auto& [name, runs] : RunsByVehicle(*build)) {
    Odometries odometries;
    for (const RunIndex run : runs) odometries.push_back(&build->runs[run].odometry);
    ChangeByMedian(odometries, [](double /*own*/, double median) { return median; });
  }
}

void RaiseNoiseByVehicle(std::vector<BuildState>* single_runs) {
  std::map<std::string, Odometries> vehicles;
  for (BuildState& build : *single_runs) {
    BuildRun& run = build.runs.front();
    vehicles[run.data->info.vehicle].push_back(&run.odometry);
  }
  for (const auto& [name, odometries] : vehicles) {
    ChangeByMedian(odometries, [](double own, double median) { return std::max(own, median); });
  }
}

Graph SolveTruncated(const MapperOptions& options,
                     int steps,
                     BuildState* build,
                     GraphSolver* solver) {
  constexpr double kCostTolerance = 1e-3;
  MapperOptions few = options;
  few.solver.max_iterations = std::min(steps, options.solver.max_iterations);
  few.solver.cost_tolerance = std::max(kCostTolerance, options.solver.cost_tolerance);
  return SolveOnce(few, build, solver);
}

void CalibrateNoise(const MapperOptions& options,
                    const NoiseRounds& rounds,
                    BuildState* build,
                    GraphSolver* solver,
                    const StepCallback& on_step) {
  constexpr int kSteps = 2;
  VarianceComponents components(build);
  for (int round = 0; round < rounds.most; ++round) {
    if (on_step && !on_step(*build)) return;
    const Graph graph =
        round == 0 ? MakeGraph(options, build) : SolveTruncated(options, kSteps, build, solver);
    const auto statistics = ComputeRunStatistics(graph, NoiseSamples(graph), options.seed, solver);
    if (!statistics || components.Step(*statistics) < rounds.settled) return;
  }
}

}  // namespace shiftmap
