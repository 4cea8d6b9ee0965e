// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

namespace shiftmap {

/// 1, 2 or 5 times a power of ten, at least `value` > 0.
double NiceStep(double value);

/// The multiples of `step` within [min, max]; the first thousand.
std::vector<double> Multiples(double min, double max, double step);

/// Where an axis that shows [min, max] has its ticks: multiples of 1, 2 or 5 times a power of ten,
/// about `count` of them, all within [min, max].
std::vector<double> LinearTicks(double min, double max, int count);

/// Powers of ten within [min, max], 0 < min.
std::vector<double> LogTicks(double min, double max);

/// A tick of a linear axis as text, with as many decimals as the ticks next to it need.
std::string LinearLabel(double value, double step);

/// A power of ten as text: `1e-3`, `0.01`, `100`, `1e4`.
std::string PowerLabel(double value);

/// A tick of an axis of time.
struct TimeTick {
  double time_s = 0.0;  ///< Since the epoch, UTC.
  std::string label;    ///< E.g. `06:00`, `01-09`, `2026-01`.
  std::string date;     ///< What the label lacks, where it changes: `2026-01-09`, `2026`.
};

/// Round times of the UTC calendar within [min_s, max_s], about `count` of them.
/// @param min_s  Since the epoch, within 290 years of it.
std::vector<TimeTick> TimeTicks(double min_s, double max_s, int count);

}  // namespace shiftmap
