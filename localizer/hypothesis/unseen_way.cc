// SPDX-License-Identifier: Apache-2.0
#include "localizer/hypothesis/unseen_way.h"

#include <algorithm>

namespace shiftmap {

void UnseenWay::Add(const MotionIncrement& increment) {
  const Eigen::Matrix2d R_begin_end = increment.T_begin_end.Rotation();
  const Eigen::Vector2d step = R_begin_end.transpose() * increment.T_begin_end.translation();
  const double length_m = step.norm();
  directions_ = (R_begin_end.transpose() * directions_ * R_begin_end).eval();
  if (!(length_m > 0.0)) return;
  directions_ += step * step.transpose() / length_m;
  length_m_ += length_m;
}

Eigen::Matrix2d UnseenWay::SlipCovariance() const {
  if (!(length_m_ > 0.0)) return Eigen::Matrix2d::Zero();
  const double longest = std::min(length_m_, kMaxSlip);
  // Uniform in [0, longest].
  return longest * longest / 3.0 / length_m_ * directions_;
}

}  // namespace shiftmap
