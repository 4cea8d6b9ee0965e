// SPDX-License-Identifier: Apache-2.0
#include "mapper/vehicle_calibration.h"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

using Parameters = Eigen::Matrix<double, 5, 1>;

constexpr double kNormal = 1.959964;  // The 97.5 % quantile.

// Noise is settled within a few percent of what residuals say, and that of one kind passes for
// another's: 2.5 % of a standard deviation are as 1 / (2 · 0.025²) degrees of freedom.
constexpr double kUnsettled = 2.0 * 0.025 * 0.025;

// Draws of the posterior for redundancies.
constexpr int kSamples = 16;

Parameters ParametersOf(const OdometryCalibration& odometry, const SensorBias& bias) {
  return {
      std::log(odometry.scale_v), std::log(odometry.scale_omega), odometry.lag_s, bias[0], bias[1]};
}

Interval Around(double value, double sd) {
  return {value, value - kNormal * sd, value + kNormal * sd};
}

Interval Exponential(const Interval& log) {
  return {std::exp(log.value), std::exp(log.low), std::exp(log.high)};
}

// A standard deviation from the squares of `count` residuals of redundancy r in all. The fit shares
// r among them about evenly, tr R² ≈ r² / count of the residuals' projection R, and as many degrees
// of freedom has the variance once what other kinds of noise leave in the residuals is told apart.
Interval NoiseInterval(double sum_of_squares, double redundancy, double count) {
  const double of_residuals = redundancy * redundancy / std::max(count, 1.0);
  const auto dof = static_cast<int>(1.0 / (1.0 / std::max(of_residuals, 1e-3) + kUnsettled));
  if (dof < 2) return {0.0, 0.0, std::numeric_limits<double>::infinity()};
  const double variance = sum_of_squares / redundancy;
  return {std::sqrt(variance),
          std::sqrt(variance * dof / ChiSquareQuantile(0.975, dof)),
          std::sqrt(variance * dof / ChiSquareQuantile(0.025, dof))};
}

Interval ShareInterval(double hits, double trials) {
  if (trials <= 0.0) return {0.5, 0.0, 1.0};
  const double share = hits / trials;
  const double z2 = kNormal * kNormal;
  const double centre = (share + 0.5 * z2 / trials) / (1.0 + z2 / trials);
  const double half = kNormal / (1.0 + z2 / trials) *
                      std::sqrt(share * (1.0 - share) / trials + 0.25 * z2 / (trials * trials));
  return {share, centre - half, centre + half};
}

// The runs of each vehicle, by name.
std::map<std::string, std::vector<std::size_t>> RunsByVehicle(const MapProblem& problem) {
  std::map<std::string, std::vector<std::size_t>> runs;
  for (std::size_t r = 0; r < problem.runs.size(); ++r) {
    runs[problem.runs[r].data->info.vehicle].push_back(r);
  }
  return runs;
}

// Systematic errors of each vehicle with their joint covariance.
struct Systematic {
  Eigen::VectorXd mean;
  Eigen::MatrixXd cov;
};

Systematic CombineRuns(const OdometryCalibration& fleet,
                       const Graph& graph,
                       const MapProblem& problem,
                       const std::map<std::string, std::vector<std::size_t>>& vehicles) {
  const auto runs = static_cast<Eigen::Index>(5 * problem.runs.size());
  const auto size = static_cast<Eigen::Index>(5 * vehicles.size());
  const Parameters prior_mean = ParametersOf(fleet, SensorBias::Zero());
  Eigen::VectorXd estimate(runs);
  Eigen::MatrixXd E = Eigen::MatrixXd::Zero(runs, size);
  Eigen::VectorXd prior = Eigen::VectorXd::Zero(size);
  Eigen::VectorXd prior_pull = Eigen::VectorXd::Zero(size);
  Eigen::Index column = 0;
  for (const auto& [name, of_vehicle] : vehicles) {
    for (const std::size_t r : of_vehicle) {
      const auto row = static_cast<Eigen::Index>(5 * r);
      estimate.segment<5>(row) =
          ParametersOf(problem.runs[r].odometry, problem.runs[r].sensor_bias);
      E.block<5, 5>(row, column).setIdentity();
      if (r == of_vehicle.front()) continue;
      Parameters information;
      information << graph.runs[r].correction_prior_sd, graph.runs[r].sensor_bias_sd;
      information = information.cwiseAbs2().cwiseInverse().eval();
      prior.segment<5>(column) += information;
      prior_pull.segment<5>(column) += information.cwiseProduct(prior_mean);
    }
    column += 5;
  }
  const Eigen::LLT<Eigen::MatrixXd> C(ComputeCalibrationCovariance(graph));
  const Eigen::MatrixXd EtC = C.solve(E).transpose();
  Eigen::MatrixXd information = EtC * E;
  information.diagonal() -= prior;
  Systematic result;
  result.cov = information.llt().solve(Eigen::MatrixXd::Identity(size, size));
  result.mean = result.cov * (EtC * estimate - prior_pull);
  return result;
}

struct DetectionCount {
  double expected = 0.0;
  double detected = 0.0;
};

// What stood in the field of view of a run's key frames. A landmark stands where the visit going on
// has it, or the last one.
void CountDetections(const MapProblem& problem, const BuildRun& run, DetectionCount* count) {
  const SensorCalibration& sensor = problem.sensor;
  std::vector<int> mode_of(problem.signatures.size(), kUnassigned);
  std::size_t next_visit = 0;
  std::vector<char> seen(problem.signatures.size());
  for (std::size_t f = 0; f < run.data->frames.size(); ++f) {
    const KeyFrame& frame = run.data->frames[f];
    for (;
         next_visit < run.data->visits.size() && run.data->visits[next_visit].begin <= frame.stamp;
         ++next_visit) {
      if (run.assignment[next_visit] == kUnassigned) continue;
      mode_of[static_cast<std::size_t>(run.data->visits[next_visit].group)] =
          run.assignment[next_visit];
    }
    std::fill(seen.begin(), seen.end(), 0);
    for (int s = frame.first_sighting; s < frame.first_sighting + frame.sighting_count; ++s) {
      const Sighting& sighting = run.data->sightings[static_cast<std::size_t>(s)];
      const auto visit = static_cast<std::size_t>(sighting.visit);
      if (!IsInlier(problem, run, sighting)) continue;
      seen[static_cast<std::size_t>(run.data->visits[visit].group)] = 1;
    }
    const auto all_seen = std::count(seen.begin(), seen.end(), 1);
    const Se2 T_vehicle_map = run.poses[f].Inverse();
    for (std::size_t group = 0; group < mode_of.size(); ++group) {
      if (mode_of[group] == kUnassigned || all_seen - seen[group] == 0) continue;
      const Eigen::Vector2d q =
          T_vehicle_map *
          problem.modes[group][static_cast<std::size_t>(mode_of[group])].p_map_landmark;
      if (q.squaredNorm() > sensor.max_range_m * sensor.max_range_m) continue;
      if (std::abs(std::atan2(q.y(), q.x())) > sensor.max_bearing_rad) continue;
      count->expected += 1.0;
      count->detected += seen[group];
    }
  }
}

// Noise of a vehicle's runs: their residuals together, each under its own run's noise.
void SetNoise(const MapProblem& problem,
              const std::vector<std::size_t>& runs,
              const std::vector<ResidualStatistics>& statistics,
              VehicleCalibration* vehicle) {
  using Kind = ResidualStatistics;
  ResidualStatistics sum;
  const SensorCalibration& sensor = problem.sensor;
  for (const std::size_t r : runs) {
    const OdometryCalibration& odometry = problem.runs[r].odometry;
    Eigen::Array<double, Kind::kKinds, 1> sd;
    sd << odometry.noise_v, odometry.noise_omega, sensor.sd_range_m, sensor.sd_bearing_rad,
        sensor.sd_position_m;
    sum.sum_of_squares += sd.square() * statistics[r].sum_of_squares;
    sum.redundancy += statistics[r].redundancy;
    sum.count += statistics[r].count;
  }
  const auto interval = [&](Kind::Kind kind) {
    return NoiseInterval(sum.sum_of_squares[kind], sum.redundancy[kind], sum.count[kind]);
  };
  vehicle->noise_v = interval(Kind::kTranslation);
  vehicle->noise_omega = interval(Kind::kYaw);
  vehicle->sd_range_m = interval(Kind::kRange);
  vehicle->sd_bearing_rad = interval(Kind::kBearing);
}

}  // namespace

std::vector<VehicleCalibration> CalibrateVehicles(const MapperOptions& options,
                                                  MapProblem* problem) {
  const Graph graph = MakeGraph(options, problem);
  const auto by_vehicle = RunsByVehicle(*problem);
  const Systematic systematic =
      CombineRuns(options.calibration.odometry, graph, *problem, by_vehicle);
  const std::vector<ResidualStatistics> statistics =
      ComputeRunStatistics(graph, kSamples, options.seed);
  std::vector<VehicleCalibration> vehicles;
  for (const auto& [name, runs] : by_vehicle) {
    const auto at = static_cast<Eigen::Index>(5 * vehicles.size());
    const auto interval = [&](Eigen::Index i) {
      return Around(systematic.mean[at + i], std::sqrt(systematic.cov(at + i, at + i)));
    };
    VehicleCalibration& vehicle = vehicles.emplace_back();
    vehicle.vehicle = name;
    vehicle.runs = static_cast<int>(runs.size());
    vehicle.scale_v = Exponential(interval(0));
    vehicle.scale_omega = Exponential(interval(1));
    vehicle.lag_s = interval(2);
    vehicle.bearing_offset_rad = interval(3);
    vehicle.range_curvature_per_rad2 = interval(4);
    SetNoise(*problem, runs, statistics, &vehicle);
    DetectionCount count;
    for (const std::size_t r : runs) CountDetections(*problem, problem->runs[r], &count);
    vehicle.detection_probability = ShareInterval(count.detected, count.expected);
  }
  return vehicles;
}

}  // namespace shiftmap
