// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

namespace shiftmap {

/// A rigid transform of the plane, SE(2), and a pose: `T_map_vehicle` maps vehicle coordinates to
/// map coordinates and is the pose of the vehicle in the map. Names chain so that inner frames
/// cancel: `T_map_lidar = T_map_vehicle * T_vehicle_lidar`.
///
/// Tangent vectors are ordered (x, y, yaw), metres and radians. Perturbations act on the right, in
/// the inner frame: `T * Exp(ξ)`.
///
/// Laws (tested in tests/property):
///   (T1 * T2) * T3 == T1 * (T2 * T3)          T * T.Inverse() == identity
///   Exp(Log(T)) == T for |yaw| < π            T * Exp(ξ) == Exp(T.Adjoint() * ξ) * T
class Se2 {
 public:
  /// The identity.
  Se2() = default;

  /// @param x_m, y_m  Translation. [m]
  /// @param yaw_rad   Rotation, counter-clockwise; any value, stored wrapped. [rad]
  Se2(double x_m, double y_m, double yaw_rad);
  Se2(const Eigen::Vector2d& translation_m, double yaw_rad)
      : Se2(translation_m.x(), translation_m.y(), yaw_rad) {}

  const Eigen::Vector2d& translation() const { return translation_; }
  double x() const { return translation_.x(); }
  double y() const { return translation_.y(); }
  double yaw() const { return yaw_; }

  /// R_outer_inner.
  Eigen::Matrix2d Rotation() const;

  Se2 Inverse() const;
  Se2 operator*(const Se2& T_b_c) const;

  /// Maps a point from the inner to the outer frame. [m]
  Eigen::Vector2d operator*(const Eigen::Vector2d& p_inner) const;

  /// Moves a twist from the inner to the outer frame: T Exp(ξ) T⁻¹ = Exp(Adjoint() ξ).
  Eigen::Matrix3d Adjoint() const;

  /// Inverse().Adjoint(), which is Adjoint()⁻¹.
  Eigen::Matrix3d InverseAdjoint() const;

  /// Exponential map: the end of the exact arc driven with constant twist ξ = (x, y, yaw) for unit
  /// time.
  static Se2 Exp(const Eigen::Vector3d& twist);

  /// Exp(ξ) with what carries an error along it: one evaluation of sine and cosine for all.
  struct Step;
  static Step ExpStep(const Eigen::Vector3d& twist);

  /// Inverse of Exp for |yaw| < π.
  Eigen::Vector3d Log() const;

  /// d Exp(ξ + δ) = Exp(ξ) Exp(J δ): the right Jacobian of Exp at ξ.
  static Eigen::Matrix3d RightJacobian(const Eigen::Vector3d& twist);

 private:
  Eigen::Vector2d translation_ = Eigen::Vector2d::Zero();
  double yaw_ = 0.0;
};

struct Se2::Step {
  Se2 T;                            ///< Exp(ξ).
  Eigen::Matrix3d inverse_adjoint;  ///< T.InverseAdjoint().
  Eigen::Matrix3d right_jacobian;   ///< RightJacobian(ξ).
};

}  // namespace shiftmap
