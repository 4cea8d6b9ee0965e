// SPDX-License-Identifier: Apache-2.0
#include "mapper/calibration/fleet_calibration.h"

#include <algorithm>
#include <cmath>

#include "localizer/models/motion_model.h"
#include "localizer/models/observation_model.h"
#include "mapper/graph/residuals.h"
#include "mapper/state/sightings.h"
#include "mapstore/core/quantile.h"

namespace shiftmap {
namespace {

// How much the systematic errors of a sensor that no run has calibrated yet differ from the
// fleet's.
constexpr double kRangeSpread = 0.03;     // [m]
constexpr double kBearingSpread = 0.015;  // [rad]

// Spread of innovations about zero, from the median of their squares, which a few outliers do not
// move.
double RobustSd(const std::vector<double>& squares) {
  constexpr double kSdOverMedianDeviation = 1.4826;
  return kSdOverMedianDeviation * std::sqrt(Quantile(squares, 0.5));
}

// Random walk of a run's odometry over spans of this length: its errors are correlated over
// seconds, and from one key frame to the next they look smaller than what a gap between landmarks
// will cost.
constexpr double kNoiseSpanSeconds = 10.0;

// Squares of the errors over such spans, per second of them.
struct MotionSquares {
  std::vector<double> x;
  std::vector<double> yaw;
};

void AddMotionSquares(const BuildRun& run, MotionSquares* squares) {
  FrameIndex first;
  Se2 T_first_odometry;
  const auto& frames = run.data->frames;
  for (FrameIndex i = 1; i < frames.end_index(); ++i) {
    if (!run.motions.between_frames[i - 1].Measured()) {
      first = i;
      T_first_odometry = Se2();
      continue;
    }
    T_first_odometry = T_first_odometry * MotionFrom(run.motions, i - 1, run.odometry).T_begin_end;
    const double seconds = ToSeconds(frames[i].stamp - frames[first].stamp);
    if (seconds < kNoiseSpanSeconds) continue;
    if (Stands(T_first_odometry)) {
      first = i;
      continue;
    }
    const Se2 T_first_i = run.poses[first].Inverse() * run.poses[i];
    const Eigen::Vector3d error = (T_first_odometry.Inverse() * T_first_i).Log();
    squares->x.push_back(error.x() * error.x() / seconds);
    squares->yaw.push_back(error.z() * error.z() / seconds);
    first = i;
    T_first_odometry = Se2();
  }
}

Eigen::Vector2d LongTermNoise(const BuildRun& run) {
  MotionSquares squares;
  AddMotionSquares(run, &squares);
  if (squares.x.empty()) return Eigen::Vector2d::Zero();
  return {RobustSd(squares.x), RobustSd(squares.yaw)};
}

// Squared innovations of a run's explained observations.
struct SensorSquares {
  std::vector<double> range;
  std::vector<double> bearing;
  std::vector<double> position;
  double squared_ranges = 0.0;  // Sum of r².
};

void AddSensorSquares(const BuildState& build,
                      const BuildRun& run,
                      const SensorBias& bias,
                      double mean_squared_bearing,
                      SensorSquares* squares) {
  for (const Sighting& sighting : run.data->sightings) {
    if (!IsInlier(build, run, sighting)) continue;
    const Eigen::Vector2d nu2 = LinearizeBiased(sighting.observation,
                                                run.poses[sighting.frame],
                                                AssignedPosition(build, run, sighting),
                                                bias,
                                                mean_squared_bearing)
                                    .nu.cwiseAbs2();
    if (sighting.observation.kind == Observation::Kind::kCartesian) {
      squares->position.insert(squares->position.end(), {nu2.x(), nu2.y()});
    } else {
      squares->range.push_back(nu2.x());
      squares->bearing.push_back(nu2.y());
      squares->squared_ranges += sighting.observation.z.x() * sighting.observation.z.x();
    }
  }
}

// What sensors of the fleet get wrong about ranges beside noise. [m]
double RangeSpread(const SensorSquares& squares, double sd_range_scale) {
  if (squares.range.empty()) return 0.0;
  const double mean_square = squares.squared_ranges / static_cast<double>(squares.range.size());
  return std::hypot(kRangeSpread, sd_range_scale * std::sqrt(mean_square));
}

// The median tells as much of a standard deviation as 37 % of the values would in squares.
NoiseEstimate RobustNoise(const std::vector<double>& squares) {
  constexpr double kEfficiency = 0.37;
  if (squares.empty()) return {};
  return {RobustSd(squares), kEfficiency * static_cast<double>(squares.size())};
}

}  // namespace

SensorCalibration FleetSensor(const BuildState& build, double sd_range_scale) {
  SensorCalibration sensor = build.sensor;
  const auto runs = static_cast<double>(build.runs.size());
  for (const BuildRun& run : build.runs) {
    sensor.range_curvature_per_rad2 += run.sensor_bias[kRangeCurvature] / runs;
    sensor.mean_squared_bearing_rad2 += run.data->mean_squared_bearing / runs;
  }
  const SensorBias common(0.0, 0.0, sensor.range_curvature_per_rad2);
  SensorSquares squares;
  for (const BuildRun& run : build.runs) {
    AddSensorSquares(build, run, common, sensor.mean_squared_bearing_rad2, &squares);
  }
  const auto raise = [](const std::vector<double>& of_kind, double spread, double* sd) {
    if (!of_kind.empty()) *sd = std::hypot(std::max(*sd, RobustSd(of_kind)), spread);
  };
  raise(squares.range, RangeSpread(squares, sd_range_scale), &sensor.sd_range_m);
  raise(squares.bearing, kBearingSpread, &sensor.sd_bearing_rad);
  raise(squares.position, kRangeSpread, &sensor.sd_position_m);
  return sensor;
}

OdometryCalibration FleetOdometry(const std::vector<BuildRun>& runs,
                                  const OdometryCalibration& fallback) {
  const auto count = static_cast<double>(runs.size());
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  double lag = 0.0;
  Eigen::Vector2d variance = Eigen::Vector2d::Zero();
  for (const BuildRun& run : runs) {
    mean +=
        Eigen::Vector2d(std::log(run.odometry.scale_v), std::log(run.odometry.scale_omega)) / count;
    lag += run.odometry.lag_s / count;
    const Eigen::Vector2d short_term(run.odometry.noise_v, run.odometry.noise_omega);
    variance += short_term.cwiseMax(LongTermNoise(run)).cwiseAbs2() / count;
  }
  OdometryCalibration fleet = fallback;
  fleet.scale_v = std::exp(mean.x());
  fleet.scale_omega = std::exp(mean.y());
  fleet.lag_s = lag;
  fleet.noise_v = std::sqrt(variance.x());
  fleet.noise_omega = std::sqrt(variance.y());
  return fleet;
}

VehicleNoise NoiseOverSeconds(const BuildState& build,
                              const std::vector<RunIndex>& runs,
                              const SensorBias& bias,
                              double mean_squared_bearing,
                              double sd_range_scale) {
  MotionSquares motion;
  SensorSquares sensor;
  for (const RunIndex r : runs) {
    const BuildRun& run = build.runs[r];
    AddMotionSquares(run, &motion);
    AddSensorSquares(build, run, bias, mean_squared_bearing, &sensor);
  }
  NoiseEstimate range = RobustNoise(sensor.range);
  range.sd = std::hypot(range.sd, RangeSpread(sensor, sd_range_scale));
  return {RobustNoise(motion.x),
          RobustNoise(motion.yaw),
          range,
          RobustNoise(sensor.bearing),
          RobustNoise(sensor.position)};
}

NoiseEstimate Larger(const NoiseEstimate& a, const NoiseEstimate& b) {
  if (!a.known() || !b.known()) return a.known() ? a : b;
  return a.sd < b.sd ? b : a;
}

}  // namespace shiftmap
