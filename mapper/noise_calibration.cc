// SPDX-License-Identifier: Apache-2.0
#include "mapper/noise_calibration.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include "mapper/graph/graph.h"
#include "mapstore/core/median.h"

namespace shiftmap {
namespace {

// A standard deviation may not change by more than this factor in one step.
constexpr double kMaxFactor = 4.0;

// Noise within this factor of what residuals say is right enough: a run of a thousand residuals
// says no more.
constexpr double kSettled = 1.05;

// Fewer degrees of freedom say nothing; as many say where steps lead.
constexpr double kMinRedundancy = 20.0;
constexpr double kTellingRedundancy = 1000.0;

// Of sd, smaller is none. [m/√s], [rad/√s], [m], [rad]
constexpr double kMinOdometry = 1e-4;
constexpr double kMinPosition = 1e-3;
constexpr double kMinBearing = 1e-4;

// A standard deviation on its way. Steps of variance components shrink by about the same factor
// each, slowly where most of what a residual is has gone into the fit; two of them tell where they
// lead (Aitken).
class Component {
 public:
  // The factor by which to change it.
  double Step(const ResidualStatistics& statistics, ResidualStatistics::Kind kind) {
    constexpr double kMaxRatio = 0.8;
    const double limit = std::log(kMaxFactor);
    if (statistics.redundancy[kind] < kMinRedundancy) return 1.0;
    double step = 0.5 * std::log(std::max(1e-300, statistics.sum_of_squares[kind]) /
                                 statistics.redundancy[kind]);
    step = std::clamp(step, -limit, limit);
    const double last = std::exchange(last_, step);
    if (last * step > 0.0 && statistics.redundancy[kind] >= kTellingRedundancy) {
      step /= 1.0 - std::min(step / last, kMaxRatio);
      last_ = 0.0;
    }
    return std::exp(std::clamp(step, -limit, limit));
  }

 private:
  double last_ = 0.0;  // Logarithm; 0 if there is none to go by.
};

class VarianceComponents {
 public:
  explicit VarianceComponents(MapProblem* problem) : problem_(problem) {
    for (const auto& [name, runs] : RunsByVehicle(*problem)) vehicles_.push_back({runs, {}, {}});
  }

  // One step of all. Returns the largest factor, 1 or more.
  double Step(const std::vector<ResidualStatistics>& statistics) {
    double largest = 1.0;
    const auto apply = [&](double factor, double least, double* sd) {
      *sd = std::max(least, *sd * factor);
      largest = std::max({largest, factor, 1.0 / factor});
    };
    ResidualStatistics all;
    for (Vehicle& vehicle : vehicles_) {
      ResidualStatistics sum;
      for (const std::size_t run : vehicle.runs) sum += statistics[run];
      all += sum;
      const double v = vehicle.noise_v.Step(sum, ResidualStatistics::kTranslation);
      const double omega = vehicle.noise_omega.Step(sum, ResidualStatistics::kYaw);
      for (const std::size_t run : vehicle.runs) {
        apply(v, kMinOdometry, &problem_->runs[run].odometry.noise_v);
        apply(omega, kMinOdometry, &problem_->runs[run].odometry.noise_omega);
      }
    }
    SensorCalibration& sensor = problem_->sensor;
    apply(range_.Step(all, ResidualStatistics::kRange), kMinPosition, &sensor.sd_range_m);
    apply(bearing_.Step(all, ResidualStatistics::kBearing), kMinBearing, &sensor.sd_bearing_rad);
    apply(position_.Step(all, ResidualStatistics::kPosition), kMinPosition, &sensor.sd_position_m);
    return largest;
  }

 private:
  struct Vehicle {
    std::vector<std::size_t> runs;
    Component noise_v;
    Component noise_omega;
  };

  MapProblem* problem_;
  std::vector<Vehicle> vehicles_;
  Component range_;
  Component bearing_;
  Component position_;
};

// Draws of the posterior for the redundancy of residuals: many residuals share few.
int NoiseSamples(const Graph& graph) {
  constexpr std::size_t kResiduals = 24'000;
  constexpr std::size_t kLeast = 4;
  constexpr std::size_t kMost = 24;
  std::size_t residuals = 2 * graph.observations.size();
  for (const GraphRun& run : graph.runs) residuals += 3 * run.motions.size();
  return static_cast<int>(
      std::clamp(kResiduals / std::max<std::size_t>(residuals, 1), kLeast, kMost));
}

}  // namespace

void PoolNoiseByVehicle(MapProblem* problem) {
  for (const auto& [name, runs] : RunsByVehicle(*problem)) {
    for (double OdometryCalibration::*noise :
         {&OdometryCalibration::noise_v, &OdometryCalibration::noise_omega}) {
      std::vector<double> values;
      for (const std::size_t run : runs) values.push_back(problem->runs[run].odometry.*noise);
      const double pooled = Median(std::move(values));
      for (const std::size_t run : runs) problem->runs[run].odometry.*noise = pooled;
    }
  }
}

void CalibrateNoise(const MapperOptions& options,
                    int rounds,
                    MapProblem* problem,
                    const GoOn& go_on) {
  // The next round goes on from where this one ends: none needs to end at the minimum.
  constexpr int kFirstIterations = 3;
  constexpr int kIterations = 2;
  constexpr double kCostTolerance = 1e-3;
  SolverLimits limits = options.solver;
  limits.cost_tolerance = std::max(kCostTolerance, limits.cost_tolerance);
  VarianceComponents components(problem);
  GraphSolver solver;
  for (int round = 0; round < rounds; ++round) {
    if (go_on && !go_on(*problem)) return;
    limits.max_iterations =
        std::min(round == 0 ? kFirstIterations : kIterations, options.solver.max_iterations);
    Graph graph = MakeGraph(options, problem);
    GraphSummary summary;
    const std::vector<ResidualStatistics> statistics =
        solver.SolveForStatistics(limits, NoiseSamples(graph), options.seed, &graph, &summary);
    CopySolution(graph, problem);
    problem->cost = summary.final_cost;
    if (components.Step(statistics) < kSettled) return;
  }
}

}  // namespace shiftmap
