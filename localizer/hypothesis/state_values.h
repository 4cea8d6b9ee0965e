// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <boost/container/small_vector.hpp>

namespace shiftmap {

/// Groups with this many states, `absent` included, need no heap memory per leaf and visit.
inline constexpr std::size_t kInlineStates = 8;

/// One value per state 0..n of a group.
using StateValues = boost::container::small_vector<double, kInlineStates>;

inline Eigen::Map<Eigen::VectorXd> AsVector(StateValues& values) {
  return {values.data(), static_cast<Eigen::Index>(values.size())};
}

inline Eigen::Map<const Eigen::VectorXd> AsVector(const StateValues& values) {
  return {values.data(), static_cast<Eigen::Index>(values.size())};
}

}  // namespace shiftmap
