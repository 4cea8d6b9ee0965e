// SPDX-License-Identifier: Apache-2.0
#include "mapper/frontend/ekf_slam.h"

#include <Eigen/LU>
#include <cmath>
#include <unordered_map>

#include "localizer/models/motion_model.h"
#include "localizer/models/observation_model.h"
#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

constexpr int kVehicle = 5;  // Pose (x, y, yaw) and (log scale_v, log scale_omega).
constexpr double kGateProbability = 0.999;

// A landmark that only its first sighting supports may have been misread; after this many misses in
// a row its place is given to the newest sighting.
constexpr int kMissesToReplace = 5;

class EkfSlam {
 public:
  explicit EkfSlam(const Calibration& calibration)
      : calibration_(calibration), gate_(ChiSquareQuantile(kGateProbability, 2)) {
    covariance_ = Eigen::MatrixXd::Zero(kVehicle, kVehicle);
    const double sd = calibration.odometry.sd_log_scale;
    covariance_(3, 3) = covariance_(4, 4) = sd * sd;
  }

  const Se2& pose() const { return pose_; }

  OdometryCalibration Odometry() const {
    OdometryCalibration odometry = calibration_.odometry;
    odometry.scale_v *= std::exp(log_scale_.x());
    odometry.scale_omega *= std::exp(log_scale_.y());
    return odometry;
  }

  void Predict(const MotionIncrement& motion) {
    pose_ = pose_ * motion.T_begin_end;
    Eigen::Matrix<double, kVehicle, kVehicle> F =
        Eigen::Matrix<double, kVehicle, kVehicle>::Identity();
    F.topLeftCorner<3, 3>() = motion.T_begin_end.InverseAdjoint();
    F.topRightCorner<3, 2>() = motion.J_calibration.leftCols<2>();
    covariance_.topRows<kVehicle>() = (F * covariance_.topRows<kVehicle>()).eval();
    covariance_.leftCols<kVehicle>() = (covariance_.leftCols<kVehicle>() * F.transpose()).eval();
    covariance_.topLeftCorner<3, 3>() += motion.cov;
  }

  void Observe(int group, const Observation& observation) {
    const auto [entry, added] = landmarks_.try_emplace(group);
    Landmark& landmark = entry->second;
    if (added) {
      landmark.offset = static_cast<int>(covariance_.rows());
      covariance_.conservativeResize(landmark.offset + 2, landmark.offset + 2);
      Place(observation, &landmark);
      return;
    }
    if (Update(observation, &landmark)) {
      ++landmark.updates;
      landmark.misses = 0;
    } else if (++landmark.misses >= kMissesToReplace && landmark.updates == 0) {
      Place(observation, &landmark);
    }
  }

 private:
  struct Landmark {
    int offset = 0;
    Eigen::Vector2d position = Eigen::Vector2d::Zero();
    int updates = 0;
    int misses = 0;
  };

  // (Re)initializes a landmark from one observation: p = T_map_vehicle q.
  void Place(const Observation& observation, Landmark* landmark) {
    const Eigen::Vector2d q = observation.PositionInVehicle();
    const Eigen::Matrix2d R = pose_.Rotation();
    landmark->position = pose_ * q;
    landmark->misses = 0;
    Eigen::Matrix<double, 2, 3> G;
    G << 1.0, 0.0, -q.y(), 0.0, 1.0, q.x();
    G = (R * G).eval();
    const int o = landmark->offset;
    covariance_.middleRows(o, 2).setZero();
    covariance_.middleCols(o, 2).setZero();
    const Eigen::MatrixXd rows = G * covariance_.topRows<3>();
    covariance_.middleRows(o, 2) = rows;
    covariance_.middleCols(o, 2) = rows.transpose();
    const Eigen::Matrix2d noise =
        PositionNoiseInVehicle(observation, ObservationNoise(observation, calibration_.sensor));
    covariance_.block<2, 2>(o, o) =
        G * covariance_.topLeftCorner<3, 3>() * G.transpose() + R * noise * R.transpose();
  }

  bool Update(const Observation& observation, Landmark* landmark) {
    const Innovation innovation = Linearize(observation, pose_, landmark->position);
    const int o = landmark->offset;
    const Eigen::MatrixXd PHt = covariance_.leftCols<3>() * innovation.H_pose.transpose() +
                                covariance_.middleCols(o, 2) * innovation.H_landmark.transpose();
    const Eigen::Matrix2d S = Symmetrized(Eigen::Matrix2d(
        innovation.H_pose * PHt.topRows<3>() + innovation.H_landmark * PHt.middleRows(o, 2) +
        ObservationNoise(observation, calibration_.sensor)));
    if (SquaredMahalanobis(innovation.nu, S) > gate_) return false;
    const Eigen::MatrixXd gain = PHt * S.inverse();
    const Eigen::VectorXd step = gain * innovation.nu;
    pose_ = pose_ * Se2::Exp(step.head<3>());
    log_scale_ += step.segment<2>(3);
    for (auto& [group, other] : landmarks_) other.position += step.segment<2>(other.offset);
    covariance_.noalias() -= gain * PHt.transpose();
    covariance_ = Symmetrized(covariance_);
    return true;
  }

  Calibration calibration_;
  double gate_;
  Se2 pose_;
  Eigen::Vector2d log_scale_ = Eigen::Vector2d::Zero();
  Eigen::MatrixXd covariance_;
  std::unordered_map<int, Landmark> landmarks_;
};

}  // namespace

std::vector<Se2> EstimateTrajectoryByEkf(const MappingRun& run, const Calibration& calibration) {
  std::vector<Se2> poses;
  EkfSlam filter(calibration);
  std::size_t hint = 0;
  for (std::size_t i = 0; i < run.frames.size(); ++i) {
    const KeyFrame& frame = run.frames[i];
    if (i > 0) {
      filter.Predict(IntegrateMotion(
          run.odometry, run.frames[i - 1].stamp, frame.stamp, filter.Odometry(), &hint));
    }
    for (int s = frame.first_sighting; s < frame.first_sighting + frame.sighting_count; ++s) {
      const Sighting& sighting = run.sightings[static_cast<std::size_t>(s)];
      filter.Observe(run.visits[static_cast<std::size_t>(sighting.visit)].group,
                     sighting.observation);
    }
    poses.push_back(filter.pose());
  }
  return poses;
}

}  // namespace shiftmap
