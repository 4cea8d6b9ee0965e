// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <limits>
#include <vector>

namespace shiftmap {

struct SampleMean {
  double mean = 0.0;
  double standard_error = 0.0;  ///< Not a number for a single value.
};

/// Of values drawn independently. Precondition: there is one.
inline SampleMean MeanOf(const std::vector<double>& values) {
  const auto n = static_cast<double>(values.size());
  // Relative to the first: equal values have no error at all.
  SampleMean result{values.front(), 0.0};
  for (const double value : values) result.mean += (value - values.front()) / n;
  double squares = 0.0;
  for (const double value : values) squares += (value - result.mean) * (value - result.mean);
  result.standard_error =
      n > 1.0 ? std::sqrt(squares / (n - 1.0) / n) : std::numeric_limits<double>::quiet_NaN();
  return result;
}

}  // namespace shiftmap
