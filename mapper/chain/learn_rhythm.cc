// SPDX-License-Identifier: Apache-2.0
#include "mapper/chain/learn_rhythm.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <utility>

#include "mapper/chain/chain_expectations.h"
#include "mapper/chain/chain_steps.h"
#include "proto/core/check.h"

namespace shiftmap {
namespace {

constexpr int kMaxIterations = 200;
constexpr double kTolerance = 1e-3;

// By how much a rhythm has to predict the held-out visits better, and that of the week better than
// that of the day. [nat]
constexpr double kMinGain = 3.0;

// A history with fewer jumps does not determine a rhythm.
constexpr double kMinJumps = 10.0;

constexpr int kHoursOfDay = 24;
constexpr int kHoursOfWeek = 168;

// Periods that a rhythm is told from at least, and that tell whether it holds.
constexpr int kLearnedPeriods = 3;
constexpr int kHeldOutPeriods = 1;

using Rates = Eigen::MatrixXd;

// One step of EM for a phase.
Rates Maximize(const Rates& at,
               const Eigen::MatrixXd& integral,
               const Rates& toward,
               double weight) {
  const Eigen::Index n = at.rows();
  Rates rates = Rates::Zero(n, n);
  for (Eigen::Index from = 0; from < n; ++from) {
    for (Eigen::Index to = 0; to < n; ++to) {
      const double mean = toward(from, to);
      if (from == to || mean == 0.0) continue;
      const double jumps = at(from, to) * integral(from, to);
      rates(from, to) = (weight + jumps) / (weight / mean + integral(from, from));
    }
  }
  rates.diagonal() = -rates.rowwise().sum();
  return rates;
}

// Largest relative change of a rate.
double Change(const Rates& before, const Rates& after) {
  double change = 0.0;
  for (Eigen::Index i = 0; i < before.size(); ++i) {
    if (before(i) != 0.0) change = std::max(change, std::abs(after(i) / before(i) - 1.0));
  }
  return change;
}

// The rates of each phase, drawn to others.
std::vector<Rates> Fit(const ChainSteps& steps, const std::vector<Rates>& toward, double weight) {
  std::vector<Rates> rates = toward;
  for (int iteration = 0; iteration < kMaxIterations; ++iteration) {
    const ChainExpectations expected = ExpectChain(steps, rates);
    double change = 0.0;
    for (std::size_t phase = 0; phase < rates.size(); ++phase) {
      Rates next = Maximize(rates[phase], expected.integrals[phase], toward[phase], weight);
      change = std::max(change, Change(rates[phase], next));
      rates[phase] = std::move(next);
    }
    if (change < kTolerance) break;
  }
  return rates;
}

// Each hour of the week with the rates of its hour of the day.
std::vector<Rates> OfWeek(const std::vector<Rates>& day) {
  std::vector<Rates> week;
  for (int hour = 0; hour < kHoursOfWeek; ++hour) {
    week.push_back(day[static_cast<std::size_t>(hour % kHoursOfDay)]);
  }
  return week;
}

// A history cut by the hours of a calendar, and what the first of its visits tell of the others.
class HeldOutTest {
 public:
  HeldOutTest(const ChainHistory& history,
              const RhythmCalendar& calendar,
              std::size_t first,
              double gap_resolution)
      : steps_(MakeChainSteps(history, calendar, gap_resolution)), first_(first) {}

  // Of the visits that are not held out.
  std::vector<Rates> FitSeen(const std::vector<Rates>& toward, double weight) const {
    return Fit(FirstVisits(steps_, first_), toward, weight);
  }

  std::vector<Rates> FitAll(const std::vector<Rates>& toward, double weight) const {
    return Fit(steps_, toward, weight);
  }

  // By how much hours predict the others better than one chain for all of them.
  double Gain(const std::vector<Rates>& hours, const Rates& plain) const {
    return PredictiveLogLikelihood(steps_, first_, hours) -
           PredictiveLogLikelihood(steps_, first_, std::vector<Rates>(hours.size(), plain));
  }

 private:
  ChainSteps steps_;
  std::size_t first_;
};

// Whether visits tell a rhythm, and the ones held out whether it holds.
bool Tells(const ChainHistory& history, std::size_t first, Duration period) {
  const std::vector<ChainVisit>& visits = history.visits;
  const Stamp end = visits[first - 1].end;
  return end - visits.front().begin >= kLearnedPeriods * period &&
         visits.back().end - end >= kHeldOutPeriods * period;
}

// The rates that the first visits tell, without a rhythm.
StatusOr<Rates> PlainRates(const ChainHistory& history,
                           std::size_t first,
                           const RateFit& whole,
                           const ChainLearningOptions& learning) {
  const ChainHistory seen = FirstVisits(history, first);
  if (learning.share_prior) {
    SHIFTMAP_ASSIGN_OR_RETURN(const LearnedChain plain, LearnChain(seen, learning));
    return plain.chain.rate_matrix();
  }
  return MostProbableRates(MakeChainSteps(seen, {}, learning.gap_resolution),
                           whole.structure,
                           learning.prior,
                           RateStart{whole.log_rates, whole.covariance});
}

}  // namespace

Status RhythmOptions::Validate() const {
  if (!(weight > 0.0) || !std::isfinite(weight)) {
    return InvalidArgument("rhythm: weight {}, expected > 0", weight);
  }
  if (!(held_out > 0.0 && held_out < 1.0)) {
    return InvalidArgument("rhythm: held out {}, expected within (0, 1)", held_out);
  }
  if (!(gap_resolution >= 0.0)) return InvalidArgument("rhythm: gap resolution {}", gap_resolution);
  return OkStatus();
}

std::vector<ModeChain> FitPhases(const ChainHistory& history,
                                 const RhythmCalendar& calendar,
                                 const std::vector<ModeChain>& toward,
                                 const RhythmOptions& options) {
  const ChainSteps steps = MakeChainSteps(history, calendar, options.gap_resolution);
  std::vector<ModeChain> chains;
  for (const Rates& rates : Fit(steps, RatesOf(toward), options.weight)) {
    StatusOr<ModeChain> chain = ModeChain::FromRates(rates);
    SHIFTMAP_CHECK(chain.ok(), "rates of a phase: {}", chain.status().ToString());
    chains.push_back(*std::move(chain));
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
  if (history.states < 2 || whole.jumps < kMinJumps || first < 2 || count - first < 2 ||
      !Tells(history, first, kRhythmDay)) {
    return result;
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const Rates plain, PlainRates(history, first, whole, learning));
  const auto cut = [&](Duration period, int hours) {
    return HeldOutTest(history, {period, hours}, first, options.gap_resolution);
  };
  const HeldOutTest by_day = cut(kRhythmDay, kHoursOfDay);
  const std::vector<Rates> day = by_day.FitSeen(std::vector(kHoursOfDay, plain), options.weight);
  const double day_gain = by_day.Gain(day, plain);
  result.held_out_gain = day_gain;
  std::optional<HeldOutTest> by_week;
  bool takes_week = false;
  if (Tells(history, first, kRhythmWeek)) {
    by_week = cut(kRhythmWeek, kHoursOfWeek);
    const double gain = by_week->Gain(by_week->FitSeen(OfWeek(day), options.weight), plain);
    takes_week = gain >= std::max(0.0, day_gain) + kMinGain;
    if (takes_week) result.held_out_gain = gain;
  }
  if (!takes_week && day_gain < kMinGain) return result;
  std::vector<Rates> rates =
      by_day.FitAll(std::vector(kHoursOfDay, whole.chain.rate_matrix()), options.weight);
  if (takes_week) rates = by_week->FitAll(OfWeek(rates), options.weight);
  SHIFTMAP_ASSIGN_OR_RETURN(
      result.rhythm, ChainRhythm::Make(takes_week ? kRhythmWeek : kRhythmDay, std::move(rates)));
  return result;
}

}  // namespace shiftmap
