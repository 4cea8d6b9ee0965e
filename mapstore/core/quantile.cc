// SPDX-License-Identifier: Apache-2.0
#include "mapstore/core/quantile.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "proto/core/check.h"

namespace shiftmap {

double Quantile(std::vector<double> values, double share) {
  SHIFTMAP_CHECK(!values.empty() && share >= 0.0 && share <= 1.0, "share {}", share);
  const double position = share * static_cast<double>(values.size() - 1);
  const auto below = values.begin() + static_cast<std::ptrdiff_t>(position);
  std::nth_element(values.begin(), below, values.end());
  const auto above = below + 1 == values.end() ? below : std::min_element(below + 1, values.end());
  return std::lerp(*below, *above, position - std::floor(position));
}

}  // namespace shiftmap
