// SPDX-License-Identifier: Apache-2.0
#include "tools/plot/ticks.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <iterator>

#include "mapstore/core/day.h"

namespace shiftmap {
namespace {

using std::chrono::days;
using std::chrono::sys_days;
using std::chrono::sys_seconds;
using std::chrono::year_month_day;

constexpr double kMinuteS = 60.0;
constexpr double kHourS = 3600.0;
constexpr double kMonthS = 30.436875 * kSecondsPerDay;

// Steps of the clock and of days; longer ones are months.
constexpr double kSteps[] = {1.0,
                             2.0,
                             5.0,
                             10.0,
                             15.0,
                             30.0,
                             kMinuteS,
                             2.0 * kMinuteS,
                             5.0 * kMinuteS,
                             10.0 * kMinuteS,
                             15.0 * kMinuteS,
                             30.0 * kMinuteS,
                             kHourS,
                             2.0 * kHourS,
                             3.0 * kHourS,
                             6.0 * kHourS,
                             12.0 * kHourS,
                             kSecondsPerDay,
                             2.0 * kSecondsPerDay,
                             4.0 * kSecondsPerDay,
                             7.0 * kSecondsPerDay,
                             14.0 * kSecondsPerDay};
constexpr int kMonthSteps[] = {1, 2, 3, 6, 12, 24, 60, 120, 240, 600};

std::string DayText(const year_month_day& day) {
  return fmt::format("{:04}-{:02}-{:02}",
                     static_cast<int>(day.year()),
                     static_cast<unsigned>(day.month()),
                     static_cast<unsigned>(day.day()));
}

TimeTick ClockTick(double time_s, double step_s) {
  const sys_seconds time{std::chrono::seconds(std::llround(time_s))};
  const sys_days day = std::chrono::floor<days>(time);
  const std::string date = DayText(year_month_day(day));
  if (step_s >= kSecondsPerDay) return {time_s, date.substr(5), date.substr(0, 4)};
  const std::chrono::hh_mm_ss clock(time - day);
  std::string label = fmt::format("{:02}:{:02}", clock.hours().count(), clock.minutes().count());
  if (step_s < kMinuteS) label += fmt::format(":{:02}", clock.seconds().count());
  return {time_s, label, date};
}

std::vector<TimeTick> MonthTicks(double min_s, double max_s, int step) {
  const auto first = year_month_day(
      std::chrono::floor<days>(sys_seconds(std::chrono::seconds(std::llround(min_s)))));
  // Counted from the year 0, so that steps of whole years fall on round ones.
  int month = static_cast<int>(first.year()) * 12 + static_cast<int>(unsigned(first.month())) - 1;
  month -= month % step;
  std::vector<TimeTick> ticks;
  for (;; month += step) {
    const year_month_day day(std::chrono::year(month / 12),
                             std::chrono::month(static_cast<unsigned>(month % 12) + 1),
                             std::chrono::day(1));
    const auto time_s = static_cast<double>(sys_seconds(sys_days(day)).time_since_epoch().count());
    if (time_s > max_s) return ticks;
    if (time_s < min_s) continue;
    const std::string date = DayText(day);
    ticks.push_back(step % 12 == 0 ? TimeTick{time_s, date.substr(0, 4), ""}
                                   : TimeTick{time_s, date.substr(0, 7), ""});
  }
}

}  // namespace

double NiceStep(double value) {
  const double power = std::pow(10.0, std::floor(std::log10(value)));
  for (const double factor : {1.0, 2.0, 5.0}) {
    if (factor * power >= value) return factor * power;
  }
  return 10.0 * power;
}

std::vector<double> Multiples(double min, double max, double step) {
  constexpr int kMost = 1000;
  std::vector<double> multiples;
  const double first = std::ceil(min / step - 1e-9);
  // Counted in integers: far from zero, a number and the next one are the same double.
  for (int i = 0; i < kMost && (first + i) * step <= max + 1e-9 * step; ++i) {
    const double k = first + i;
    multiples.push_back(k == 0.0 ? 0.0 : k * step);
  }
  return multiples;
}

std::vector<double> LinearTicks(double min, double max, int count) {
  return Multiples(min, max, NiceStep((max - min) / count));
}

std::vector<double> LogTicks(double min, double max) {
  std::vector<double> ticks;
  const double last = std::floor(std::log10(max) + 1e-9);
  for (double k = std::ceil(std::log10(min) - 1e-9); k <= last; ++k) {
    ticks.push_back(std::pow(10.0, k));
  }
  return ticks;
}

std::string LinearLabel(double value, double step) {
  const int decimals = std::clamp(static_cast<int>(-std::floor(std::log10(step) + 1e-9)), 0, 9);
  return fmt::format("{:.{}f}", value, decimals);
}

std::string PowerLabel(double value) {
  const int power = static_cast<int>(std::lround(std::log10(value)));
  if (power >= -2 && power <= 3) return fmt::format("{:g}", std::pow(10.0, power));
  return fmt::format("1e{}", power);
}

std::vector<TimeTick> TimeTicks(double min_s, double max_s, int count) {
  const double wanted_s = (max_s - min_s) / count;
  const auto* const step = std::lower_bound(std::begin(kSteps), std::end(kSteps), wanted_s);
  std::vector<TimeTick> ticks;
  if (step == std::end(kSteps)) {
    const auto* const months =
        std::lower_bound(std::begin(kMonthSteps), std::end(kMonthSteps), wanted_s / kMonthS);
    ticks = MonthTicks(min_s, max_s, months == std::end(kMonthSteps) ? 600 : *months);
  } else {
    for (double k = std::ceil(min_s / *step); k * *step <= max_s; ++k) {
      ticks.push_back(ClockTick(k * *step, *step));
    }
  }
  for (std::size_t i = ticks.size(); i-- > 1;) {
    if (ticks[i].date == ticks[i - 1].date) ticks[i].date.clear();
  }
  return ticks;
}

}  // namespace shiftmap
