// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/circular_buffer.hpp>

namespace shiftmap {

/// The probability with which the model itself would give innovations as large or larger.
///
/// The sum Q of n normalized innovations νᵀ S⁻¹ ν of 2 degrees of freedom each has the mean 2n.
/// They are not independent: the sensor's bias and the errors of the modes are shared by all of
/// them. So Q is taken for a scaled chi-square variable with its own mean and variance
/// (Satterthwaite): Q / c ~ χ²(2n / c) with c = 1 + (n - 1) r, r the correlation of two terms of
/// the sum.
/// @param nis_sum  Q.
/// @param count    n, at least 1.
double InnovationTail(double nis_sum, int count);

/// How well the last observations fit the pose.
class InnovationQuality {
 public:
  /// Observations gone by.
  static constexpr int kWindow = 24;

  /// @param nis  Of an observation that corrected the pose.
  void Add(double nis);

  /// InnovationTail() of the window, uniform in [0, 1] if the model holds; 1 while it is empty.
  double p_value() const;

  void Reset() { window_.clear(); }

 private:
  boost::circular_buffer<double> window_{kWindow};
};

}  // namespace shiftmap
