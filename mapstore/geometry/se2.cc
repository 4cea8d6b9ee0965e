// SPDX-License-Identifier: Apache-2.0
#include "mapstore/geometry/se2.h"

#include <cmath>

#include "mapstore/geometry/angle.h"

namespace shiftmap {
namespace {

// sin(θ)/θ and (1 - cos(θ))/θ, and their limits at 0. Below the bound the next term of the series
// is smaller than one unit in the last place.
struct ArcFactors {
  double sinc;
  double cosc;
};

constexpr double kSmallAngle = 1e-4;

// 1 - cos(θ) without the cancellation for small θ.
double OneMinusCos(double theta) {
  const double s = std::sin(0.5 * theta);
  return 2.0 * s * s;
}

ArcFactors ComputeArcFactors(double theta) {
  if (std::abs(theta) < kSmallAngle) {
    const double theta2 = theta * theta;
    return {1.0 - theta2 / 6.0, theta * (0.5 - theta2 / 24.0)};
  }
  return {std::sin(theta) / theta, OneMinusCos(theta) / theta};
}

}  // namespace

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

Se2 Se2::Exp(const Eigen::Vector3d& twist) {
  const auto [sinc, cosc] = ComputeArcFactors(twist.z());
  return Se2(sinc * twist.x() - cosc * twist.y(), cosc * twist.x() + sinc * twist.y(), twist.z());
}

Eigen::Vector3d Se2::Log() const {
  const auto [sinc, cosc] = ComputeArcFactors(yaw_);
  const double scale = 1.0 / (sinc * sinc + cosc * cosc);
  return {scale * (sinc * x() + cosc * y()), scale * (-cosc * x() + sinc * y()), yaw_};
}

Eigen::Matrix3d Se2::RightJacobian(const Eigen::Vector3d& twist) {
  const double theta = twist.z();
  const auto [sinc, cosc] = ComputeArcFactors(theta);
  // (θ - sin θ)/θ² and (1 - cos θ)/θ², undefined at 0.
  double a = theta / 6.0;
  double b = 0.5 - theta * theta / 24.0;
  if (std::abs(theta) >= kSmallAngle) {
    a = (theta - std::sin(theta)) / (theta * theta);
    b = OneMinusCos(theta) / (theta * theta);
  }
  Eigen::Matrix3d jacobian = Eigen::Matrix3d::Identity();
  jacobian(0, 0) = sinc;
  jacobian(0, 1) = cosc;
  jacobian(1, 0) = -cosc;
  jacobian(1, 1) = sinc;
  jacobian(0, 2) = a * twist.x() - b * twist.y();
  jacobian(1, 2) = b * twist.x() + a * twist.y();
  return jacobian;
}

}  // namespace shiftmap
