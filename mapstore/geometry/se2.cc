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

// From sin(θ) and cos(θ): 1 - cos(θ) = sin²(θ) / (1 + cos(θ)) does not cancel for small θ, and is
// the better form for all but obtuse angles.
ArcFactors MakeArcFactors(double theta, double s, double c) {
  if (std::abs(theta) < kSmallAngle) {
    const double theta2 = theta * theta;
    return {1.0 - theta2 / 6.0, theta * (0.5 - theta2 / 24.0)};
  }
  const double one_minus_cos = c > 0.0 ? s * s / (1.0 + c) : 1.0 - c;
  return {s / theta, one_minus_cos / theta};
}

ArcFactors ComputeArcFactors(double theta) {
  return MakeArcFactors(theta, std::sin(theta), std::cos(theta));
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

Eigen::Matrix3d Se2::InverseAdjoint() const {
  Eigen::Matrix3d adjoint = Eigen::Matrix3d::Identity();
  const Eigen::Matrix2d R_transposed = Rotation().transpose();
  adjoint.topLeftCorner<2, 2>() = R_transposed;
  adjoint.topRightCorner<2, 1>() =
      R_transposed * Eigen::Vector2d(-translation_.y(), translation_.x());
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
  return ExpStep(twist).right_jacobian;
}

Se2::Step Se2::ExpStep(const Eigen::Vector3d& twist) {
  const double theta = twist.z();
  const double s = std::sin(theta);
  const double c = std::cos(theta);
  const auto [sinc, cosc] = MakeArcFactors(theta, s, c);
  Step step;
  step.T = Se2(sinc * twist.x() - cosc * twist.y(), cosc * twist.x() + sinc * twist.y(), theta);
  const double x = step.T.x();
  const double y = step.T.y();
  step.inverse_adjoint << c, s, s * x - c * y, -s, c, c * x + s * y, 0.0, 0.0, 1.0;
  // (θ - sin θ)/θ² and (1 - cos θ)/θ², undefined at 0.
  double a = theta / 6.0;
  double b = 0.5 - theta * theta / 24.0;
  if (std::abs(theta) >= kSmallAngle) {
    a = (theta - s) / (theta * theta);
    b = cosc / theta;
  }
  step.right_jacobian << sinc, cosc, a * twist.x() - b * twist.y(), -cosc, sinc,
      b * twist.x() + a * twist.y(), 0.0, 0.0, 1.0;
  return step;
}

}  // namespace shiftmap
