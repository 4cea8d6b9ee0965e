// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace shiftmap {

/// Bounds of 95 % in standard deviations of a normal error: its 97.5 % quantile.
inline constexpr double kSigmas95 = 1.959964;

/// A value, and bounds that hold the truth with 95 % if not said otherwise.
struct Interval {
  double value = 0.0;
  double low = 0.0;
  double high = 0.0;
};

/// A value with a normal error.
struct Estimate {
  double value = 0.0;
  double sd = 0.0;  ///< Standard deviation of the error.
};

/// The standard deviation of a noise, estimated from its squares.
struct NoiseEstimate {
  double sd = 0.0;
  double dof = 0.0;  ///< Degrees of freedom of sd²; below 2 it counts as unknown.

  bool known() const { return dof >= 2.0; }
};

/// A probability, estimated as a share.
struct ShareEstimate {
  double share = 0.5;
  double trials = 0.0;
};

/// Normal quantiles.
Interval IntervalOf(const Estimate& estimate);

/// χ² quantiles; (0, 0, infinity) of one that is not known.
Interval IntervalOf(const NoiseEstimate& noise);

/// Wilson (1927), `sigmas` of the normal distribution to either side; [0, 1] without a trial.
Interval IntervalOf(const ShareEstimate& share, double sigmas = kSigmas95);

/// The exponential of the values and their bounds.
Interval Exponential(const Interval& log);

}  // namespace shiftmap
