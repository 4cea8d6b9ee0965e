// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <type_traits>

namespace shiftmap {

/// Calls a function template with the number of states as a constant, for matrices of fixed size:
/// up to four, as most landmarks have, else Eigen::Dynamic.
/// @param call  Takes a std::integral_constant<int, kStates>.
template <typename Call>
auto WithFixedStates(Eigen::Index states, Call&& call) {
  switch (states) {
    case 2:
      return call(std::integral_constant<int, 2>());
    case 3:
      return call(std::integral_constant<int, 3>());
    case 4:
      return call(std::integral_constant<int, 4>());
    default:
      return call(std::integral_constant<int, Eigen::Dynamic>());
  }
}

}  // namespace shiftmap
