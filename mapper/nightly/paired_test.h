// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

namespace shiftmap {

/// Bounds of PairedTest.
struct PairedTestOptions {
  double margin = 0.0;  ///< δ > 0: what the mean of the differences may be worse by.
  double level = 0.05;  ///< Probability that a map which is worse by δ passes.

  /// Shifts of an honest night differ by about δ / 4: a variance known beforehand, with so many
  /// degrees of freedom. It is what a night of one shift is judged by.
  double prior_dof = 4.0;
  double prior_share = 0.25;
};

/// What a paired test says.
struct PairedTestResult {
  int shifts = 0;
  double mean = 0.0;   ///< d̄
  double upper = 0.0;  ///< U
  double margin = 0.0;
  bool not_worse() const { return upper <= margin; }
};

/// Whether the new map is not worse than the old one: a one-sided test of non-inferiority over
/// shifts, each of which was replayed on both maps.
///
/// d_i is the measure on the new map minus that on the old one, larger is worse. One shift decides
/// nothing alone: d_i is held within [-δ, 4δ]. With n shifts, their mean d̄, and ν = n - 1 + ν₀,
///
///     s² = (Σ (d_i - d̄)² + ν₀ (κδ)²) / ν        ν₀ = prior_dof, κ = prior_share
///     U  = d̄ + t(1 - level, ν) s / √n
///
/// the map is not worse if U <= δ: a map that is worse by δ in the mean passes with the probability
/// `level`. t(p, ν) is the quantile of Student's distribution.
/// Without a shift nothing is known, and U is 0.
PairedTestResult PairedTest(std::span<const double> differences, const PairedTestOptions& options);

}  // namespace shiftmap
