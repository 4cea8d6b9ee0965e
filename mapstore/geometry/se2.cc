// SPDX-License-Identifier: Apache-2.0
#include "mapstore/geometry/se2.h"

#include <cmath>

#include "mapstore/geometry/angle.h"
#include "mapstore/geometry/arc_factors.h"

namespace shiftmap {
Se2::Se2(double x_m, double y_m, double yaw_rad)
    : translation_(x_m, y_m), yaw_(WrapAngle(yaw_rad)) {}

Eigen::Matrix2d Se2::Rotation() const {
  const double c = std::cos(yaw_);
  const double s = std::sin(yaw_);
  return (Eigen::Matrix2d() << c, -s, s, c).finished();
}

Se2 Se2::Inverse() const {
  const Eigen::Vector2d translation = -(Rotation().transpose() * translation_);
  return Se2(translation, -yaw_);
}

Se2 Se2::operator*(const Se2& T_b_c) const {
  const Eigen::Vector2d translation = translation_ + Rotation() * T_b_c.translation_;
  return Se2(translation, yaw_ + T_b_c.yaw_);
}

Eigen::Vector2d Se2::operator*(const Eigen::Vector2d& p_inner) const {
  return translation_ + Rotation() * p_inner;
}

Eigen::Matrix3d Se2::Adjoint() const {
  Eigen::Matrix3d adjoint = Eigen::Matrix3d::Identity();
  adjoint.topLeftCorner<2, 2>() = Rotation();
  adjoint(0, 2) = translation_.y();
  adjoint(1, 2) = -translation_.x();
  return adjoint;
}

Eigen::Matrix3d Se2::InverseAdjoint() const {
  Eigen::Matrix3d adjoint = Eigen::Matrix3d::Identity();
  const Eigen::Matrix2d R_transposed = Rotation().transpose();
  adjoint.topLeftCorner<2, 2>() = R_transposed;
  adjoint.topRightCorner<2, 1>() =
      R_transposed * Eigen::Vector2d(-translation_.y(), translation_.x());
  return adjoint;
}

Se2 Se2::Exp(const Eigen::Vector3d& twist) {
  const ArcFactors f = ComputeArcFactors(twist.z());
  return Se2(
      f.sinc * twist.x() - f.cosc * twist.y(), f.cosc * twist.x() + f.sinc * twist.y(), twist.z());
}

Eigen::Vector3d Se2::Log() const {
  const ArcFactors f = ComputeArcFactors(yaw_);
  const double scale = 1.0 / (f.sinc * f.sinc + f.cosc * f.cosc);
  return {scale * (f.sinc * x() + f.cosc * y()), scale * (-f.cosc * x() + f.sinc * y()), yaw_};
}

Eigen::Matrix3d Se2::RightJacobian(const Eigen::Vector3d& twist) {
  return ExpStep(twist).right_jacobian;
}

Se2::Step Se2::ExpStep(const Eigen::Vector3d& twist) {
  const ArcFactors f = ComputeArcFactors(twist.z());
  Step step;
  step.T = Se2(
      f.sinc * twist.x() - f.cosc * twist.y(), f.cosc * twist.x() + f.sinc * twist.y(), twist.z());
  const double x = step.T.x();
  const double y = step.T.y();
  step.inverse_adjoint << f.cos, f.sin, f.sin * x - f.cos * y, -f.sin, f.cos, f.cos * x + f.sin * y,
      0.0, 0.0, 1.0;
  step.right_jacobian << f.sinc, f.cosc, f.sinc_rest * twist.x() - f.cosc_rest * twist.y(), -f.cosc,
      f.sinc, f.cosc_rest * twist.x() + f.sinc_rest * twist.y(), 0.0, 0.0, 1.0;
  return step;
}

}  // namespace shiftmap
