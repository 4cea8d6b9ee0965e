// SPDX-License-Identifier: Apache-2.0
#include "localizer/initialization/start_pose.h"

#include <cmath>

namespace shiftmap {
namespace {

// Quantiles of chi-square, 3 degrees of freedom.
constexpr double k999 = 16.3;
constexpr double k95 = 7.81;

double SquaredDistance(const PoseWithCovariance& a, const PoseWithCovariance& b) {
  return SquaredMahalanobis(
      a.T_map_vehicle, b.T_map_vehicle, a.cov_T_map_vehicle + b.cov_T_map_vehicle);
}

}  // namespace

Status ValidateStart(const PoseWithCovariance& pose) {
  const Se2& T = pose.T_map_vehicle;
  if (!std::isfinite(T.yaw()) || !(std::abs(T.x()) <= kMaxStartDistanceM) ||
      !(std::abs(T.y()) <= kMaxStartDistanceM)) {
    return InvalidArgument("pose: ({}, {}, {}), expected finite numbers up to {}",
                           T.x(),
                           T.y(),
                           T.yaw(),
                           kMaxStartDistanceM);
  }
  const Eigen::Matrix3d& cov = pose.cov_T_map_vehicle;
  if (!IsSymmetricPositiveDefinite(cov)) {
    return InvalidArgument("pose: covariance is not positive definite");
  }
  const Eigen::Vector3d sd = cov.diagonal().cwiseSqrt();
  if (sd.minCoeff() < kMinStartSd || sd.head<2>().maxCoeff() > kMaxStartPositionSdM ||
      sd.z() > kMaxStartYawSdRad) {
    return InvalidArgument(
        "pose: standard deviations ({}, {}, {}), expected {} to {} m and {} to {} rad",
        sd.x(),
        sd.y(),
        sd.z(),
        kMinStartSd,
        kMaxStartPositionSdM,
        kMinStartSd,
        kMaxStartYawSdRad);
  }
  return OkStatus();
}

bool ClearlyApart(const PoseWithCovariance& a, const PoseWithCovariance& b) {
  return SquaredDistance(a, b) > k999;
}

bool Apart(const PoseWithCovariance& a, const PoseWithCovariance& b) {
  return SquaredDistance(a, b) > k95;
}

}  // namespace shiftmap
