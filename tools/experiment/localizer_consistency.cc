// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/localizer_consistency.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <vector>

#include "localizer/filter/known_map_filter.h"
#include "localizer/models/motion_model.h"
#include "localizer/models/observation_model.h"
#include "mapper/parallel.h"
#include "mapstore/geometry/covariance.h"
#include "tools/experiment/dice.h"

namespace shiftmap {
namespace {

constexpr double kScanPeriod = 0.25;  // [s]
constexpr double kSpeed = 0.5;        // [m/s]
constexpr double kYawRate = 0.2;      // [rad/s]
constexpr double kHalfSize = 8.0;     // [m]
constexpr double kMinRange = 1.0;     // Nearer ones are below the sensor. [m]
constexpr double kMinSd = 1e-4;       // A map's covariance is positive definite. [m]

MapContent DrawMap(const ConsistencyScene& scene, Dice* dice) {
  const double sd = std::max(scene.sd_map_m, kMinSd);
  MapContent content;
  content.calibration.sensor.max_range_m = 8.0;
  std::vector<Eigen::Matrix2d> marginals;
  std::vector<JointCovariance::CrossBlock> cross;
  const Eigen::Matrix2d cov = Eigen::Matrix2d::Identity() * (sd * sd);
  for (int i = 0; i < scene.landmarks; ++i) {
    LandmarkGroup group;
    group.signature = Signature(std::to_string(100 + i));
    const double x = dice->Uniform(-kHalfSize, kHalfSize);
    Mode& mode = group.modes.emplace_back();
    mode.number = ModeNumber(1);
    mode.p_map_landmark = {x, dice->Uniform(-kHalfSize, kHalfSize)};
    mode.cov_p_map_landmark = cov;
    group.chain = ModeChain::Uniform(1, 1e-9);
    group.probabilities = Eigen::Vector2d(0.01, 0.99);
    content.groups.push_back(group);
    marginals.push_back(cov);
    for (int j = 0; j < i; ++j) cross.push_back({j, i, scene.correlation * cov});
  }
  content.covariance = JointCovariance(marginals, cross);
  return content;
}

// Where the landmarks really are: a common shift and an error of each.
std::vector<Eigen::Vector2d> DrawLandmarks(const ConsistencyScene& scene,
                                           const MapSnapshot& map,
                                           Dice* dice) {
  const Eigen::Vector2d common = std::sqrt(scene.correlation) * dice->Normal2();
  std::vector<Eigen::Vector2d> places;
  for (const LandmarkGroup& group : map.groups()) {
    const Eigen::Vector2d own = std::sqrt(1.0 - scene.correlation) * dice->Normal2();
    places.push_back(group.modes[0].p_map_landmark +
                     std::max(scene.sd_map_m, kMinSd) * (common + own));
  }
  return places;
}

// An EKF of (x, y, yaw) for which map, sensor and odometry have no errors but noise.
class ExactMapFilter {
 public:
  explicit ExactMapFilter(const PoseWithCovariance& start)
      : T_map_vehicle_(start.T_map_vehicle), P_(start.cov_T_map_vehicle) {}

  void Predict(const MotionIncrement& increment) {
    T_map_vehicle_ = T_map_vehicle_ * increment.T_begin_end;
    const Eigen::Matrix3d F = increment.T_begin_end.InverseAdjoint();
    P_ = F * P_ * F.transpose() + increment.cov;
  }

  void Update(const Observation& observation, const Eigen::Matrix2d& R, const Eigen::Vector2d& p) {
    const Innovation innovation = Linearize(observation, T_map_vehicle_, p);
    const Eigen::Matrix<double, 2, 3>& H = innovation.H_pose;
    const Eigen::Matrix2d S = H * P_ * H.transpose() + R;
    const Eigen::Matrix<double, 3, 2> K = P_ * H.transpose() * S.inverse();
    T_map_vehicle_ = T_map_vehicle_ * Se2::Exp(K * innovation.nu);
    P_ = Symmetrized(Eigen::Matrix3d(P_ - K * S * K.transpose()));
  }

  PoseWithCovariance Pose() const { return {T_map_vehicle_, P_}; }

 private:
  Se2 T_map_vehicle_;
  Eigen::Matrix3d P_;
};

struct PoseError {
  double nees = 0.0;
  double squared_m2 = 0.0;
};

PoseError ErrorOf(const PoseWithCovariance& pose, const Se2& T_map_vehicle) {
  return {SquaredMahalanobis(pose.T_map_vehicle, T_map_vehicle, pose.cov_T_map_vehicle),
          (T_map_vehicle.translation() - pose.T_map_vehicle.translation()).squaredNorm()};
}

struct RunErrors {
  PoseError considered;
  PoseError exact;
};

RunErrors Drive(const ConsistencyScene& scene, std::uint64_t seed) {
  Dice dice(seed);
  const MapSnapshot map("area", VersionNumber(1), "", DrawMap(scene, &dice));
  const Calibration& calibration = map.calibration();
  const SensorCalibration& sensor = calibration.sensor;
  const std::vector<Eigen::Vector2d> landmarks = DrawLandmarks(scene, map, &dice);
  const Eigen::Vector2d sd_z(sensor.sd_range_m, sensor.sd_bearing_rad);
  const Eigen::Vector2d bias = KnownMapFilter::kBiasShare * sd_z.cwiseProduct(dice.Normal2());
  // Drawn apart, so that the rest of a world is the same whatever its scale.
  const double range_scale = std::exp(KnownMapFilter::kSdLogRangeScale * Dice(~seed).Normal());
  const Eigen::Vector2d log_scale = calibration.odometry.sd_log_scale * dice.Normal2();

  const PoseWithCovariance start{Se2(0.0, -2.5, 0.0),
                                 Eigen::Vector3d(0.04, 0.04, 0.0025).asDiagonal()};
  const Eigen::Vector2d shift = 0.2 * dice.Normal2();
  Se2 T_map_vehicle = start.T_map_vehicle * Se2::Exp({shift.x(), shift.y(), 0.05 * dice.Normal()});
  KnownMapFilter considered(start, calibration);
  ExactMapFilter exact(start);
  const int scans = static_cast<int>(scene.duration_s / kScanPeriod);
  for (int i = 0; i < scans; ++i) {
    MotionIncrement motion;
    AppendMotion(kSpeed, kYawRate, FromSeconds(kScanPeriod), calibration.odometry, &motion);
    const Eigen::Vector3d twist(
        kSpeed * std::exp(log_scale.x()), 0.0, kYawRate * std::exp(log_scale.y()));
    const Eigen::Vector2d slip = dice.Normal2();
    const Eigen::Vector3d sd = motion.cov.diagonal().cwiseSqrt();
    T_map_vehicle = T_map_vehicle * Se2::Exp(kScanPeriod * twist) *
                    Se2::Exp(sd.cwiseProduct(Eigen::Vector3d(slip.x(), slip.y(), dice.Normal())));
    considered.Predict(motion, kScanPeriod);
    exact.Predict(motion);
    for (std::size_t j = 0; j < landmarks.size(); ++j) {
      const Eigen::Vector2d q = T_map_vehicle.Inverse() * landmarks[j];
      const Eigen::Vector2d expected(q.norm(), std::atan2(q.y(), q.x()));
      const bool in_view = expected.x() > kMinRange && expected.x() < sensor.max_range_m &&
                           std::abs(expected.y()) < sensor.max_bearing_rad;
      if (!in_view || dice.Uniform(0.0, 1.0) > sensor.detection_probability) continue;
      Observation observation;
      observation.z = expected.cwiseProduct(Eigen::Vector2d(range_scale, 1.0)) + bias +
                      sd_z.cwiseProduct(dice.Normal2());
      const Eigen::Matrix2d R = ObservationNoise(observation, sensor);
      const ModeRef mode{static_cast<int>(j), 1};
      considered.Update(considered.PredictObservation(observation, R, mode, map), mode, map);
      exact.Update(observation, R, map.groups()[j].modes[0].p_map_landmark);
    }
  }
  return {ErrorOf(considered.Pose(), T_map_vehicle), ErrorOf(exact.Pose(), T_map_vehicle)};
}

}  // namespace

ConsistencyResult MeasureConsistency(const ConsistencyScene& scene,
                                     std::uint64_t first_seed,
                                     int runs,
                                     int threads) {
  std::vector<RunErrors> errors(static_cast<std::size_t>(runs));
  ForEachIndex(errors.size(), threads, [&](std::size_t run) {
    errors[run] = Drive(scene, first_seed + run);
  });
  ConsistencyResult result;
  for (const RunErrors& run : errors) {
    result.nees += run.considered.nees / runs;
    result.nees_exact += run.exact.nees / runs;
    result.rmse_m += run.considered.squared_m2 / runs;
    result.rmse_exact_m += run.exact.squared_m2 / runs;
  }
  result.rmse_m = std::sqrt(result.rmse_m);
  result.rmse_exact_m = std::sqrt(result.rmse_exact_m);
  return result;
}

}  // namespace shiftmap
