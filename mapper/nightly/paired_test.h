// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

namespace shiftmap {

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
///     s² = (Σ (d_i - d̄)² + ν₀ (κδ)²) / ν        ν₀ = 4, κ = 1/4
///     U  = d̄ + t(95 %, ν) s / √n
///
/// the map is not worse if U <= δ: a map that is worse by δ in the mean passes with 5 %. t(p, ν) is
/// the quantile of Student's distribution. Shifts of an honest night differ by about κδ: a variance
/// known beforehand, with ν₀ degrees of freedom. It is what a night of one shift is judged by.
/// Without a shift nothing is known, and U is 0.
/// @param margin  δ > 0: what the mean of the differences may be worse by.
PairedTestResult PairedTest(std::span<const double> differences, double margin);

}  // namespace shiftmap
