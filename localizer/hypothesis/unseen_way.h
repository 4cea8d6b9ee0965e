// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include "localizer/models/motion_model.h"

namespace shiftmap {

/// The way that a vehicle has driven by odometry alone, and how far its wheels may have slipped on
/// it. Odometry does not show a slip, so no covariance of a motion has it.
class UnseenWay {
 public:
  /// A slip is taken to be no longer. [m]
  static constexpr double kMaxSlip = 2.5;

  void Add(const MotionIncrement& increment);
  void Clear() { *this = UnseenWay(); }

  double length_m() const { return length_m_; }

  /// Of the translation that one slip takes off the way: anywhere on it, along the heading of then,
  /// by up to the whole way and kMaxSlip. Vehicle frame at the end. [m²]
  Eigen::Matrix2d SlipCovariance() const;

 private:
  double length_m_ = 0.0;
  Eigen::Matrix2d directions_ = Eigen::Matrix2d::Zero();  // ∫ u uᵀ ds, u the heading of then. [m]
};

}  // namespace shiftmap
