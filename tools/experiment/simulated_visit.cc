// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/simulated_visit.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "localizer/filter/known_map_filter.h"
#include "tools/experiment/dice.h"

namespace shiftmap {
namespace {

constexpr double kSpeed = 0.5;        // [m/s]
constexpr double kMaxYawRate = 0.15;  // [rad/s]
constexpr double kOutlierSigmas = 6.0;

// Of the odometry of recorded robots, once their scales are known.
constexpr double kCalibratedLogScale = 0.025;
constexpr double kCalibratedYawNoise = 0.03;  // [rad/√s]
constexpr double kMaxSlip = 5.0;              // [s]

bool TooNear(const std::vector<Mode>& modes, const Eigen::Vector2d& p, double spacing) {
  for (const Mode& mode : modes) {
    if ((mode.p_map_landmark - p).norm() < spacing) return true;
  }
  return false;
}

LandmarkGroup DrawGroup(const VisitScene& scene, int number, Dice* dice) {
  LandmarkGroup group;
  group.signature = Signature(std::to_string(100 + number));
  const double range = dice->Uniform(3.0, 7.0);
  const double bearing = dice->Uniform(-0.7, 0.7);
  const Eigen::Vector2d first = range * Eigen::Vector2d(std::cos(bearing), std::sin(bearing));
  while (static_cast<int>(group.modes.size()) < scene.modes) {
    Mode mode;
    mode.number = ModeNumber(static_cast<std::int64_t>(group.modes.size()) + 1);
    mode.cov_p_map_landmark = Eigen::Matrix2d::Identity() * (scene.sd_mode_m * scene.sd_mode_m);
    mode.p_map_landmark = first;
    if (!group.modes.empty()) {
      const double distance = dice->Uniform(scene.spacing_min_m, scene.spacing_max_m);
      const double direction = dice->Uniform(-std::numbers::pi, std::numbers::pi);
      mode.p_map_landmark += distance * Eigen::Vector2d(std::cos(direction), std::sin(direction));
    }
    if (!TooNear(group.modes, mode.p_map_landmark, scene.spacing_min_m))
      group.modes.push_back(mode);
  }
  group.probabilities.resize(scene.modes + 1);
  for (int state = 1; state <= scene.modes; ++state) {
    group.probabilities[state] = dice->Uniform(0.1, 1.0);
  }
  group.probabilities[0] = 0.0;
  group.probabilities *= (1.0 - scene.absent_share) / group.probabilities.sum();
  group.probabilities[0] = scene.absent_share;
  group.chain = ModeChain::Uniform(scene.modes, 1e-9);
  return group;
}

MapContent DrawMap(const VisitScene& scene, Dice* dice) {
  MapContent content;
  content.stamp = VisitStamp(-1);
  SensorCalibration& sensor = content.calibration.sensor;
  sensor.max_range_m = 8.0;
  sensor.detection_probability = scene.detection_probability;
  sensor.clutter_density_per_m2 = scene.clutter_density_per_m2;
  sensor.new_landmark_density_per_m2 = scene.clutter_density_per_m2;
  if (scene.blind_s > 0.0) {
    content.calibration.odometry.sd_log_scale = kCalibratedLogScale;
    content.calibration.odometry.noise_omega = kCalibratedYawNoise;
  }
  std::vector<Eigen::Matrix2d> marginals;
  for (int i = 0; i < scene.groups; ++i) {
    content.groups.push_back(DrawGroup(scene, i, dice));
    for (const Mode& mode : content.groups.back().modes) {
      marginals.push_back(mode.cov_p_map_landmark);
    }
  }
  content.covariance = JointCovariance(marginals, {});
  return content;
}

// What is true of the vehicle for the whole visit.
struct Truth {
  Eigen::Vector2d log_scale;
  double range_scale = 1.0;
  Eigen::Vector2d bias;  // Of (range, bearing).
  std::vector<bool> occluded;
};

// A false alarm: evenly over the sector.
Eigen::Vector2d DrawFalseAlarm(const SensorCalibration& sensor, Dice* dice) {
  const double range = sensor.max_range_m * std::sqrt(dice->Uniform(0.0, 1.0));
  return {range, dice->Uniform(-sensor.max_bearing_rad, sensor.max_bearing_rad)};
}

void LookAt(
    const VisitScene& scene, const Truth& truth, int group, SimulatedVisit* visit, Dice* dice) {
  const SensorCalibration& sensor = visit->content.calibration.sensor;
  const auto index = static_cast<std::size_t>(group);
  const bool absent = visit->true_states[index] == 0;
  Observation observation;
  observation.signature = visit->content.groups[index].signature;

  const Eigen::Vector2d q = visit->T_map_vehicle.back().Inverse() * visit->p_landmarks[index];
  const Eigen::Vector2d expected(q.norm(), std::atan2(q.y(), q.x()));
  const bool in_view = !absent && !truth.occluded[index] && expected.x() < sensor.max_range_m &&
                       std::abs(expected.y()) < sensor.max_bearing_rad;
  // A landmark that is seen hides the false alarms of its signature, those of an absent one may be
  // a new place as well.
  if (in_view && dice->Coin(sensor.detection_probability)) {
    const double sigmas = dice->Coin(scene.outlier_share) ? kOutlierSigmas : 1.0;
    const Eigen::Vector2d sd(sensor.sd_range_m, sensor.sd_bearing_rad);
    observation.z = expected.cwiseProduct(Eigen::Vector2d(truth.range_scale, 1.0)) + truth.bias +
                    sigmas * sd.cwiseProduct(dice->Normal2());
    if (observation.z.x() < 0.01) return;
  } else {
    const double area = sensor.max_range_m * sensor.max_range_m * sensor.max_bearing_rad;
    double density = sensor.clutter_density_per_m2;
    if (absent) density += sensor.new_landmark_density_per_m2;
    if (!dice->Coin(density * area)) return;
    observation.z = DrawFalseAlarm(sensor, dice);
  }
  visit->scans.back().observations.push_back(observation);
}

}  // namespace

Stamp VisitStamp(int scan) { return StampFromSeconds(1000.0 + kVisitScanPeriod * (scan + 1)); }

SimulatedVisit SimulateVisit(const VisitScene& scene, std::uint64_t seed) {
  Dice dice(seed);
  SimulatedVisit visit;
  visit.content = DrawMap(scene, &dice);
  const Calibration& calibration = visit.content.calibration;
  const Eigen::Vector2d sd_z(calibration.sensor.sd_range_m, calibration.sensor.sd_bearing_rad);
  Truth truth;
  truth.log_scale = calibration.odometry.sd_log_scale * dice.Normal2();
  truth.range_scale = std::exp(KnownMapFilter::kSdLogRangeScale * dice.Normal());
  truth.bias = KnownMapFilter::kBiasShare * sd_z.cwiseProduct(dice.Normal2());
  for (const LandmarkGroup& group : visit.content.groups) {
    const int state = dice.Index(group.probabilities);
    visit.true_states.push_back(state);
    truth.occluded.push_back(dice.Coin(calibration.sensor.occluded_visit_probability));
    const Eigen::Vector2d error = scene.sd_mode_m * dice.Normal2();
    const auto mode = static_cast<std::size_t>(std::max(state, 1)) - 1;
    visit.p_landmarks.push_back(group.modes[mode].p_map_landmark + error);
  }
  const Eigen::Vector3d sd(scene.sd_pose_m, scene.sd_pose_m, scene.sd_yaw_rad);
  visit.start.cov_T_map_vehicle = sd.cwiseAbs2().asDiagonal();
  Se2 T_map_vehicle = Se2::Exp(dice.Normal3(visit.start.cov_T_map_vehicle));

  const double yaw_rate = dice.Uniform(-kMaxYawRate, kMaxYawRate);
  const Eigen::Vector3d twist(
      kSpeed * std::exp(truth.log_scale.x()), 0.0, yaw_rate * std::exp(truth.log_scale.y()));
  MotionIncrement blind;
  if (scene.blind_s > 0.0) {
    // By odometry it ends where the landmarks are drawn from.
    AppendMotion(kSpeed, yaw_rate, FromSeconds(scene.blind_s), calibration.odometry, &blind);
    visit.start.T_map_vehicle = blind.T_begin_end.Inverse();
    double driven_s = scene.blind_s;
    if (dice.Coin(scene.slip_share)) {
      driven_s -= dice.Uniform(0.0, std::min(kMaxSlip, scene.blind_s));
    }
    T_map_vehicle = visit.start.T_map_vehicle * T_map_vehicle * Se2::Exp(driven_s * twist) *
                    Se2::Exp(dice.Normal3(blind.cov));
  }
  for (int i = 0; i < scene.scans; ++i) {
    MotionIncrement motion;
    AppendMotion(kSpeed, yaw_rate, FromSeconds(kVisitScanPeriod), calibration.odometry, &motion);
    T_map_vehicle =
        T_map_vehicle * Se2::Exp(kVisitScanPeriod * twist) * Se2::Exp(dice.Normal3(motion.cov));
    visit.elapsed_s.push_back(kVisitScanPeriod);
    if (i == 0 && scene.blind_s > 0.0) {
      AppendMotion(kSpeed, yaw_rate, FromSeconds(kVisitScanPeriod), calibration.odometry, &blind);
      motion = blind;
      visit.elapsed_s.back() += scene.blind_s;
    }
    visit.motions.push_back(motion);
    visit.T_map_vehicle.push_back(T_map_vehicle);
    visit.scans.emplace_back().stamp = VisitStamp(i);
    const int seen = i < scene.alone_scans ? 1 : scene.groups;
    for (int group = 0; group < seen; ++group) {
      LookAt(scene, truth, group, &visit, &dice);
    }
  }
  return visit;
}

}  // namespace shiftmap
