// SPDX-License-Identifier: Apache-2.0
#include "mapper/chain/learn_rhythm.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

#include "mapper/chain/chain_expectations.h"
#include "mapper/chain/chain_steps.h"
#include "proto/core/check.h"

namespace shiftmap {
namespace {

constexpr int kMaxIterations = 200;
constexpr double kTolerance = 1e-3;

constexpr int kHoursOfDay = 24;
constexpr int kHoursOfWeek = 168;

// Periods that a rhythm is told from at least, and that tell whether it holds.
constexpr int kLearnedPeriods = 3;
constexpr int kHeldOutPeriods = 1;

// One step of EM for a phase.
Eigen::MatrixXd Maximize(const ModeChain& chain,
                         const Eigen::MatrixXd& integral,
                         const ModeChain& toward,
                         double weight) {
  const int n = chain.states();
  Eigen::MatrixXd rates = Eigen::MatrixXd::Zero(n, n);
  for (int from = 0; from < n; ++from) {
    for (int to = 0; to < n; ++to) {
      const double mean = toward.rate_matrix()(from, to);
      if (from == to || mean == 0.0) continue;
      const double jumps = chain.rate_matrix()(from, to) * integral(from, to);
      rates(from, to) = (weight + jumps) / (weight / mean + integral(from, from));
    }
  }
  rates.diagonal() = -rates.rowwise().sum();
  return rates;
}

// Largest relative change of a rate.
double Change(const Eigen::MatrixXd& before, const Eigen::MatrixXd& after) {
  double change = 0.0;
  for (Eigen::Index i = 0; i < before.size(); ++i) {
    if (before(i) != 0.0) change = std::max(change, std::abs(after(i) / before(i) - 1.0));
  }
  return change;
}

// A chain for each hour of a calendar.
struct Hours {
  RhythmCalendar calendar;
  std::vector<ModeChain> chains;
};

// The hours of the day, drawn to a chain.
Hours FitDay(const ChainHistory& history, const ModeChain& whole, const RhythmOptions& options) {
  const RhythmCalendar day{kRhythmDay, kHoursOfDay};
  return {day, FitPhases(history, day, {kHoursOfDay, whole}, options)};
}

// The hours of the week, drawn to those of the day.
Hours FitWeek(const ChainHistory& history, const Hours& day, const RhythmOptions& options) {
  const RhythmCalendar week{kRhythmWeek, kHoursOfWeek};
  std::vector<ModeChain> toward;
  for (int hour = 0; hour < kHoursOfWeek; ++hour) {
    toward.push_back(day.chains[static_cast<std::size_t>(hour % kHoursOfDay)]);
  }
  return {week, FitPhases(history, week, toward, options)};
}

// How the visits are split into those that are learned from and those that decide.
struct Split {
  const ChainHistory& history;
  ChainHistory seen;

  bool Tells(Duration period) const {
    const std::vector<ChainVisit>& visits = history.visits;
    const Stamp end = seen.visits.back().end;
    return end - visits.front().begin >= kLearnedPeriods * period &&
           visits.back().end - end >= kHeldOutPeriods * period;
  }

  double Predicted(const Hours& hours, double gap_resolution) const {
    return PredictiveLogLikelihood(
        history, seen.visits.size(), hours.chains, hours.calendar.period, gap_resolution);
  }
};

StatusOr<ChainRhythm> RhythmOf(const Hours& hours) {
  std::vector<Eigen::MatrixXd> rates;
  for (const ModeChain& chain : hours.chains) rates.push_back(chain.rate_matrix());
  return ChainRhythm::Make(hours.calendar.period, std::move(rates));
}

}  // namespace

Status RhythmOptions::Validate() const {
  if (!(weight > 0.0) || !std::isfinite(weight)) {
    return InvalidArgument("rhythm: weight {}, expected > 0", weight);
  }
  if (!(held_out > 0.0 && held_out < 1.0)) {
    return InvalidArgument("rhythm: held out {}, expected within (0, 1)", held_out);
  }
  if (!(min_gain >= 0.0)) return InvalidArgument("rhythm: gain {}, expected >= 0", min_gain);
  if (!(min_jumps >= 0.0)) return InvalidArgument("rhythm: jumps {}, expected >= 0", min_jumps);
  if (!(gap_resolution >= 0.0)) return InvalidArgument("rhythm: gap resolution {}", gap_resolution);
  return OkStatus();
}

std::vector<ModeChain> FitPhases(const ChainHistory& history,
                                 const RhythmCalendar& calendar,
                                 const std::vector<ModeChain>& toward,
                                 const RhythmOptions& options) {
  const ChainSteps steps = MakeChainSteps(history, calendar, options.gap_resolution);
  std::vector<ModeChain> chains = toward;
  for (int iteration = 0; iteration < kMaxIterations; ++iteration) {
    const ChainExpectations expected = ExpectChain(steps, chains);
    double change = 0.0;
    for (std::size_t phase = 0; phase < chains.size(); ++phase) {
      const Eigen::MatrixXd rates =
          Maximize(chains[phase], expected.integrals[phase], toward[phase], options.weight);
      change = std::max(change, Change(chains[phase].rate_matrix(), rates));
      StatusOr<ModeChain> chain = ModeChain::FromRates(rates);
      SHIFTMAP_CHECK(chain.ok(), "rates of a phase: {}", chain.status().ToString());
      chains[phase] = *std::move(chain);
    }
    if (change < kTolerance) break;
  }
  return chains;
}

StatusOr<LearnedRhythm> LearnRhythm(const ChainHistory& history,
                                    const RateFit& whole,
                                    const ChainLearningOptions& learning,
                                    const RhythmOptions& options) {
  SHIFTMAP_RETURN_IF_ERROR(options.Validate());
  SHIFTMAP_RETURN_IF_ERROR(CheckHistory(history));
  const auto count = history.visits.size();
  const auto first =
      static_cast<std::size_t>(static_cast<double>(count) * (1.0 - options.held_out));
  LearnedRhythm result;
  if (history.states < 2 || whole.jumps < options.min_jumps || first < 2 || count - first < 2) {
    return result;
  }
  const Split split{history, FirstVisits(history, first)};
  if (!split.Tells(kRhythmDay)) return result;
  SHIFTMAP_ASSIGN_OR_RETURN(const LearnedChain plain, LearnChain(split.seen, learning));
  const double gap_resolution = options.gap_resolution;
  const double without = split.Predicted({{}, {plain.chain()}}, gap_resolution);
  const Hours day = FitDay(split.seen, plain.chain(), options);
  const double day_gain = split.Predicted(day, gap_resolution) - without;
  const bool takes_day = day_gain >= options.min_gain;
  result.held_out_gain = day_gain;
  bool takes_week = false;
  if (split.Tells(kRhythmWeek)) {
    const Hours week = FitWeek(split.seen, day, options);
    const double gain = split.Predicted(week, gap_resolution) - without;
    takes_week = gain >= std::max(0.0, day_gain) + options.min_gain;
    if (takes_week) result.held_out_gain = gain;
  }
  if (!takes_day && !takes_week) return result;
  Hours hours = FitDay(history, whole.chain, options);
  if (takes_week) hours = FitWeek(history, hours, options);
  SHIFTMAP_ASSIGN_OR_RETURN(result.rhythm, RhythmOf(hours));
  return result;
}

}  // namespace shiftmap
