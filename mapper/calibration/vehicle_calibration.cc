// SPDX-License-Identifier: Apache-2.0
#include "mapper/calibration/vehicle_calibration.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <map>

#include "mapper/calibration/detection.h"
#include "mapper/calibration/fleet_calibration.h"
#include "mapper/state/sightings.h"

namespace shiftmap {
namespace {

// A run's calibration, order of CalibrationInformationTimes(). Localizers leave the scale of
// ranges in their noise.
using Parameters = Eigen::Vector<double, kRunCalibration>;
const Eigen::Array<int, 5, 1> kTakenOff = {0, 1, 2, 4, 5};

// Noise is settled within a few percent of what residuals say, and that of one kind passes for
// another's: 2.5 % of a standard deviation are as 1 / (2 · 0.025²) degrees of freedom.
constexpr double kUnsettled = 2.0 * 0.025 * 0.025;

// Draws of the posterior for redundancies.
constexpr int kStatisticsSamples = 4;

Parameters ParametersOf(const OdometryCalibration& odometry, const SensorBias& bias) {
  Parameters parameters;
  parameters << std::log(odometry.scale_v), std::log(odometry.scale_omega), odometry.lag_s, bias;
  return parameters;
}

// A standard deviation from the squares of `count` residuals of redundancy r in all. The fit shares
// r among them about evenly, tr R² ≈ r² / count of the residuals' projection R, and as many degrees
// of freedom has the variance once what other kinds of noise leave in the residuals is told apart.
NoiseEstimate NoiseFrom(double sum_of_squares, double redundancy, double count) {
  const double of_residuals = redundancy * redundancy / std::max(count, 1.0);
  const double dof = 1.0 / (1.0 / std::max(of_residuals, 1e-3) + kUnsettled);
  if (dof < 2.0) return {};
  return {std::sqrt(sum_of_squares / redundancy), dof};
}

// Systematic errors of all vehicles with their joint covariance, and the prior that is in it.
struct Systematic {
  Eigen::VectorXd mean;
  Eigen::MatrixXd cov;
  Parameters prior_mean;
  Parameters prior_sd;

  SystematicErrors Of(Eigen::Index vehicle) const {
    const Eigen::Array<int, 5, 1> rows = kTakenOff + static_cast<int>(kRunCalibration * vehicle);
    return {mean(rows), cov(rows, rows), prior_mean(kTakenOff), prior_sd(kTakenOff)};
  }

  // The logarithm; 0 for runs that cannot estimate it.
  // @param sd_run  Of what a run's is known to beforehand. [-]
  Estimate RangeScaleOf(Eigen::Index vehicle, bool tells_scales, double sd_run) const {
    const Eigen::Index row = kRunCalibration * vehicle + kRangeScaleRow;
    return {mean[row], tells_scales ? std::sqrt(cov(row, row)) : sd_run};
  }
};

Systematic CombineRuns(const OdometryCalibration& fleet,
                       const Graph& graph,
                       const GraphPosterior& posterior,
                       const BuildState& build,
                       const std::map<std::string, std::vector<RunIndex>>& vehicles) {
  const Eigen::Index runs = kRunCalibration * build.runs.end_index();
  const auto size = static_cast<Eigen::Index>(kRunCalibration * vehicles.size());
  Systematic result;
  result.prior_mean = ParametersOf(fleet, SensorBias::Zero());
  result.prior_sd << graph.runs.front().correction_prior_sd, graph.runs.front().sensor_bias_sd;
  const Parameters information_of_prior = result.prior_sd.cwiseAbs2().cwiseInverse();
  Eigen::VectorXd estimate(runs);
  Eigen::MatrixXd E = Eigen::MatrixXd::Zero(runs, size);
  Eigen::VectorXd prior = Eigen::VectorXd::Zero(size);
  Eigen::VectorXd prior_pull = Eigen::VectorXd::Zero(size);
  Eigen::Index column = 0;
  for (const auto& [name, of_vehicle] : vehicles) {
    for (const RunIndex r : of_vehicle) {
      const Eigen::Index row = kRunCalibration * r;
      estimate.segment<kRunCalibration>(row) =
          ParametersOf(build.runs[r].odometry, build.runs[r].sensor_bias);
      E.block<kRunCalibration, kRunCalibration>(row, column).setIdentity();
      if (r == of_vehicle.front()) continue;
      prior.segment<kRunCalibration>(column) += information_of_prior;
      prior_pull.segment<kRunCalibration>(column) +=
          information_of_prior.cwiseProduct(result.prior_mean);
    }
    column += kRunCalibration;
  }
  const Eigen::MatrixXd EtC = posterior.CalibrationInformationTimes(E).transpose();
  Eigen::MatrixXd information = EtC * E;
  information.diagonal() -= prior;
  result.cov = information.llt().solve(Eigen::MatrixXd::Identity(size, size));
  result.mean = result.cov * (EtC * estimate - prior_pull);
  return result;
}

// Noise of a vehicle's runs: their residuals together, each under its own run's noise.
VehicleNoise ScatterOf(const BuildState& build,
                       const std::vector<RunIndex>& runs,
                       const RunStatistics& statistics) {
  using Kind = ResidualStatistics;
  ResidualStatistics sum;
  const SensorCalibration& sensor = build.sensor;
  for (const RunIndex r : runs) {
    const OdometryCalibration& odometry = build.runs[r].odometry;
    Eigen::Array<double, Kind::kKinds, 1> sd;
    sd << odometry.noise_v, odometry.noise_omega, sensor.sd_range_m, sensor.sd_bearing_rad,
        sensor.sd_position_m;
    sum.sum_of_squares += sd.square() * statistics[r].sum_of_squares;
    sum.redundancy += statistics[r].redundancy;
    sum.count += statistics[r].count;
  }
  const auto noise = [&](Kind::Kind kind) {
    return NoiseFrom(sum.sum_of_squares[kind], sum.redundancy[kind], sum.count[kind]);
  };
  return {noise(Kind::kTranslation),
          noise(Kind::kYaw),
          noise(Kind::kRange),
          noise(Kind::kBearing),
          noise(Kind::kPosition)};
}

Estimate EstimateOf(const SystematicErrors& errors, Eigen::Index i) {
  return {errors.mean[i], std::sqrt(errors.cov(i, i))};
}

ShareEstimate DetectionOf(const BuildState& build,
                          const ModeGrid& grid,
                          const std::vector<RunIndex>& runs) {
  DetectionCount count;
  for (const RunIndex r : runs) {
    CountDetections(build, build.sensor, grid, build.runs[r], &count);
  }
  if (count.expected == 0.0) return {};
  return {count.detected / count.expected, count.expected};
}

// What a map knows of the vehicle from these runs.
VehicleCalibration CalibrationFrom(const BuildState& build,
                                   const ModeGrid& grid,
                                   const std::string& name,
                                   const std::vector<RunIndex>& runs,
                                   const SystematicErrors& errors,
                                   const VehicleNoise& scatter,
                                   double sd_range_scale) {
  VehicleCalibration vehicle;
  vehicle.vehicle = name;
  vehicle.runs = static_cast<std::int64_t>(runs.size());
  for (const RunIndex r : runs) {
    const MappingRun& run = *build.runs[r].data;
    vehicle.stamp = std::max(vehicle.stamp, run.end);
    vehicle.mean_squared_bearing_rad2 +=
        run.mean_squared_bearing / static_cast<double>(runs.size());
  }
  vehicle.log_scale_v = EstimateOf(errors, 0);
  vehicle.log_scale_omega = EstimateOf(errors, 1);
  vehicle.lag_s = EstimateOf(errors, 2);
  vehicle.bearing_offset_rad = EstimateOf(errors, 3);
  vehicle.range_curvature_per_rad2 = EstimateOf(errors, 4);
  const SensorBias bias(0.0, errors.mean[3], errors.mean[4]);
  const VehicleNoise noise =
      NoiseOverSeconds(build, runs, bias, vehicle.mean_squared_bearing_rad2, sd_range_scale);
  vehicle.noise_v = Larger(scatter.v, noise.v);
  vehicle.noise_omega = Larger(scatter.omega, noise.omega);
  vehicle.range_m = Larger(scatter.range_m, noise.range_m);
  vehicle.bearing_rad = Larger(scatter.bearing_rad, noise.bearing_rad);
  vehicle.position_m = Larger(scatter.position_m, noise.position_m);
  vehicle.detection = DetectionOf(build, grid, runs);
  return vehicle;
}

}  // namespace

std::vector<VehicleEstimate> CalibrateVehicles(const MapperOptions& options,
                                               const Graph& graph,
                                               const GraphPosterior& posterior,
                                               const BuildState& build) {
  const auto by_vehicle = RunsByVehicle(build);
  const Systematic systematic =
      CombineRuns(options.calibration.odometry, graph, posterior, build, by_vehicle);
  const RunStatistics statistics =
      ComputeRunStatistics(graph, posterior, kStatisticsSamples, options.seed);
  const ModeGrid grid = GridOf(build, build.sensor.max_range_m);
  std::vector<VehicleEstimate> vehicles;
  for (const auto& [name, runs] : by_vehicle) {
    const auto index = static_cast<Eigen::Index>(vehicles.size());
    VehicleEstimate& vehicle = vehicles.emplace_back();
    vehicle.vehicle = name;
    vehicle.runs = static_cast<int>(runs.size());
    vehicle.systematic = systematic.Of(index);
    const VehicleNoise scatter = ScatterOf(build, runs, statistics);
    vehicle.calibration = CalibrationFrom(
        build, grid, name, runs, vehicle.systematic, scatter, options.sd_range_scale);
    const VehicleCalibration& found = vehicle.calibration;
    vehicle.scale_v = Exponential(IntervalOf(found.log_scale_v));
    vehicle.scale_omega = Exponential(IntervalOf(found.log_scale_omega));
    vehicle.lag_s = IntervalOf(found.lag_s);
    vehicle.range_scale = Exponential(
        IntervalOf(systematic.RangeScaleOf(index, TellsScales(build), options.sd_run_range_scale)));
    vehicle.bearing_offset_rad = IntervalOf(found.bearing_offset_rad);
    vehicle.range_curvature_per_rad2 = IntervalOf(found.range_curvature_per_rad2);
    vehicle.noise_v = IntervalOf(scatter.v);
    vehicle.noise_omega = IntervalOf(scatter.omega);
    vehicle.sd_range_m = IntervalOf(scatter.range_m);
    vehicle.sd_bearing_rad = IntervalOf(scatter.bearing_rad);
    vehicle.detection_probability = IntervalOf(found.detection);
  }
  return vehicles;
}

}  // namespace shiftmap
