// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "proto/core/status.h"

namespace shiftmap {

/// The Gamma distribution of a rate: density ∝ x^(shape - 1) exp(-exposure x). As a prior it says
/// what `shape` jumps in `exposure` seconds would.
struct Gamma {
  double shape = 1.0;       ///< > 0.
  double exposure_s = 1.0;  ///< > 0. [s]

  double mean() const { return shape / exposure_s; }  ///< [1/s]

  double MeanLog() const;  ///< E log x.

  /// The density of log x at x = exp(log_rate), logarithm.
  double LogDensityOfLog(double log_rate) const;

  /// x with P(X < x) = probability, 0 < probability < 1. [1/s]
  double Quantile(double probability) const;
};

/// The Gamma distribution of the mean and the variance of a mixture, in which `second` has a share
/// in [0, 1].
Gamma MixtureOf(const Gamma& first, const Gamma& second, double share);

/// The Gamma distribution of a given mean and mean logarithm, as maximum likelihood has it.
/// The shape is kept within [0.01, 1e6]. Precondition: mean > 0, mean_log <= log(mean) but for
/// rounding.
Gamma GammaFromMeans(double mean, double mean_log);

}  // namespace shiftmap
