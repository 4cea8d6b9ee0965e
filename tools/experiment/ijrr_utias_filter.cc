// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/ijrr_utias_filter.h"

#include <Eigen/LU>

#include "localizer/models/observation_model.h"
#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

Eigen::Index At(int mode) { return 3 + 2 * static_cast<Eigen::Index>(mode); }

// P Hᵀ for the two blocks of H that are not zero.
Eigen::MatrixXd CrossCovariance(const Eigen::MatrixXd& cov,
                                const Innovation& innovation,
                                int mode) {
  return cov.leftCols<3>() * innovation.H_pose.transpose() +
         cov.middleCols<2>(At(mode)) * innovation.H_landmark.transpose();
}

Eigen::Matrix2d InnovationCovariance(const Eigen::MatrixXd& cross,
                                     const Innovation& innovation,
                                     const Eigen::Matrix2d& cov_z,
                                     int mode) {
  return Symmetrized(Eigen::Matrix2d(innovation.H_pose * cross.topRows<3>() +
                                     innovation.H_landmark * cross.middleRows<2>(At(mode)) +
                                     cov_z));
}

}  // namespace

ModeFilter::ModeFilter(const Se2& T_map_vehicle, const Eigen::Vector3d& pose_sd)
    : T_map_vehicle_(T_map_vehicle), cov_(pose_sd.cwiseAbs2().asDiagonal()) {}

int ModeFilter::AddKnown(const Eigen::Vector2d& p_map_landmark, double sd_m) {
  const Eigen::Index n = cov_.rows();
  cov_.conservativeResizeLike(Eigen::MatrixXd::Zero(n + 2, n + 2));
  cov_.bottomRightCorner<2, 2>().diagonal().setConstant(sd_m * sd_m);
  modes_.push_back(p_map_landmark);
  return static_cast<int>(modes_.size()) - 1;
}

int ModeFilter::AddSeen(const Observation& observation, const Eigen::Matrix2d& cov_z) {
  // p = t + R (q + δq + ξ_xy + ξ_yaw × q) to first order.
  const Eigen::Vector2d q = observation.PositionInVehicle();
  const Eigen::Matrix2d R = T_map_vehicle_.Rotation();
  Eigen::Matrix<double, 2, 3> J_pose;
  J_pose << R, R * Eigen::Vector2d(-q.y(), q.x());
  const Eigen::Matrix2d cov_q = PositionNoiseInVehicle(observation, cov_z);
  const Eigen::Index n = cov_.rows();
  const Eigen::MatrixXd cross = J_pose * cov_.topRows<3>();
  cov_.conservativeResize(n + 2, n + 2);
  cov_.bottomLeftCorner(2, n) = cross;
  cov_.topRightCorner(n, 2) = cross.transpose();
  cov_.bottomRightCorner<2, 2>() =
      cross.leftCols<3>() * J_pose.transpose() + R * cov_q * R.transpose();
  modes_.push_back(T_map_vehicle_ * q);
  return static_cast<int>(modes_.size()) - 1;
}

void ModeFilter::Move(const MotionIncrement& motion) {
  const Eigen::Matrix3d F = motion.T_begin_end.InverseAdjoint();
  cov_.topRows<3>() = (F * cov_.topRows<3>()).eval();
  cov_.leftCols<3>() = (cov_.leftCols<3>() * F.transpose()).eval();
  cov_.topLeftCorner<3, 3>() += motion.cov;
  T_map_vehicle_ = T_map_vehicle_ * motion.T_begin_end;
}

double ModeFilter::SquaredDistance(const Observation& observation,
                                   const Eigen::Matrix2d& cov_z,
                                   int mode) const {
  const Innovation innovation =
      Linearize(observation, T_map_vehicle_, modes_[static_cast<std::size_t>(mode)]);
  const Eigen::MatrixXd cross = CrossCovariance(cov_, innovation, mode);
  return SquaredMahalanobis(innovation.nu, InnovationCovariance(cross, innovation, cov_z, mode));
}

void ModeFilter::Update(const Observation& observation, const Eigen::Matrix2d& cov_z, int mode) {
  const Innovation innovation =
      Linearize(observation, T_map_vehicle_, modes_[static_cast<std::size_t>(mode)]);
  const Eigen::MatrixXd cross = CrossCovariance(cov_, innovation, mode);
  const Eigen::Matrix2d S = InnovationCovariance(cross, innovation, cov_z, mode);
  const Eigen::MatrixXd K = cross * S.inverse();
  const Eigen::VectorXd step = K * innovation.nu;
  T_map_vehicle_ = T_map_vehicle_ * Se2::Exp(step.head<3>());
  for (std::size_t k = 0; k < modes_.size(); ++k) {
    modes_[k] += step.segment<2>(At(static_cast<int>(k)));
  }
  cov_ -= K * cross.transpose();
  cov_ = Symmetrized(cov_);
}

}  // namespace shiftmap
