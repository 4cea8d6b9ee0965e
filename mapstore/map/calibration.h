// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>

namespace shiftmap {

/// Of OdometryCalibration::lag_s, either way. [s]
inline constexpr double kMaxLagS = 60.0;

/// Bounds of an estimate of P_D0. No sensor is known to see always, or never: a miss, or a
/// sighting, would then decide alone.
inline constexpr double kMinDetection = 0.05;
inline constexpr double kMaxDetection = 0.95;

/// What a fleet's odometry gets wrong, and by how much that differs between vehicles:
/// true v = scale_v · measured v, true ω = scale_omega · measured ω, each read `lag_s` later.
struct OdometryCalibration {
  double scale_v = 1.0;      ///< True over measured speed. [-]
  double scale_omega = 1.0;  ///< True over measured yaw rate. [-]
  double lag_s = 0.0;        ///< The motion at time t is what odometry says of t - lag. [s]

  /// Standard deviation of log(scale) between vehicles of the fleet. [-]
  double sd_log_scale = 0.05;

  /// Random walk of the motion: variance grows per second driven. [m/√s], [rad/√s]
  double noise_v = 0.02;
  double noise_omega = 0.05;
};

/// The sensor that sees landmarks: noise, field of view, detection, clutter.
struct SensorCalibration {
  double sd_range_m = 0.15;      ///< Standard deviation of a range. [m]
  double sd_bearing_rad = 0.03;  ///< Standard deviation of a bearing. [rad]
  double sd_position_m = 0.15;   ///< Of each coordinate of a Cartesian observation. [m]

  /// Systematic error of a range: r is read as r (1 + κ (b² - b̄²)) at bearing b. Cameras that infer
  /// range from apparent size read the depth r cos b: κ ≈ -1/2.
  double range_curvature_per_rad2 = 0.0;   ///< κ. [1/rad²]
  double mean_squared_bearing_rad2 = 0.0;  ///< b̄²: where ranges are right. [rad²]

  /// Bearings are read too large by this: how the sensor is mounted, each vehicle's own. A fleet
  /// has none. [rad]
  double bearing_offset_rad = 0.0;

  /// Sector field of view: γ_r and γ_b of IJRR 7.2.
  double max_range_m = 10.0;
  double max_bearing_rad = 1.0;

  /// P_D0 of T-IV (19): probability of detecting a landmark that is in the field of view. In (0,
  /// 1).
  double detection_probability = 0.5;

  /// Share of visits in which a landmark that is there is not seen at all, e.g. behind a parked
  /// truck. It bounds what silence can prove in one visit. In (0, 1).
  double occluded_visit_probability = 0.05;

  /// Poisson densities of clutter and of undiscovered landmarks, T-IV (20), per m² of the vehicle
  /// frame and scan.
  double clutter_density_per_m2 = 1e-4;
  double new_landmark_density_per_m2 = 1e-4;
};

/// What a map version tells a localizer about the vehicles that drive on it.
struct Calibration {
  OdometryCalibration odometry;
  SensorCalibration sensor;
};

/// Every value of a fleet's calibration, in the order in which files and the content hash have
/// them.
inline std::array<double*, 17> CalibrationValues(Calibration* calibration) {
  OdometryCalibration& odometry = calibration->odometry;
  SensorCalibration& sensor = calibration->sensor;
  // All but the bearing offset, which a fleet does not have.
  static_assert(sizeof(Calibration) == 18 * sizeof(double), "a value is missing below");
  return {&odometry.scale_v,
          &odometry.scale_omega,
          &odometry.lag_s,
          &odometry.sd_log_scale,
          &odometry.noise_v,
          &odometry.noise_omega,
          &sensor.sd_range_m,
          &sensor.sd_bearing_rad,
          &sensor.sd_position_m,
          &sensor.range_curvature_per_rad2,
          &sensor.mean_squared_bearing_rad2,
          &sensor.max_range_m,
          &sensor.max_bearing_rad,
          &sensor.detection_probability,
          &sensor.occluded_visit_probability,
          &sensor.clutter_density_per_m2,
          &sensor.new_landmark_density_per_m2};
}

/// Their names, with units.
inline constexpr std::array<const char*, 17> kCalibrationNames = {
    "odometry_scale_v",
    "odometry_scale_omega",
    "odometry_lag_s",
    "odometry_sd_log_scale",
    "odometry_noise_v_m_per_sqrt_s",
    "odometry_noise_omega_rad_per_sqrt_s",
    "sensor_sd_range_m",
    "sensor_sd_bearing_rad",
    "sensor_sd_position_m",
    "sensor_range_curvature_per_rad2",
    "sensor_mean_squared_bearing_rad2",
    "sensor_max_range_m",
    "sensor_max_bearing_rad",
    "sensor_detection_probability",
    "sensor_occluded_visit_probability",
    "sensor_clutter_density_per_m2",
    "sensor_new_landmark_density_per_m2"};

/// The same of a calibration that cannot be written to.
inline std::array<double, 17> CalibrationValues(const Calibration& calibration) {
  Calibration copy = calibration;
  std::array<double, 17> values{};
  std::size_t i = 0;
  for (const double* value : CalibrationValues(&copy)) values[i++] = *value;
  return values;
}

}  // namespace shiftmap
