// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/chain_rhythm.h"

#include <cmath>
#include <utility>

#include "mapstore/map/rate_matrix.h"

namespace shiftmap {
namespace {

// From so many periods on, one of them is raised to a power.
constexpr std::int64_t kManyPeriods = 3;

// Jumps up to which the terms of the series are fewer than the squarings cost.
constexpr double kMostJumps = 8.0;
constexpr int kMostTerms = 64;
constexpr double kNegligible = 1e-17;

}  // namespace

ChainRhythm::ChainRhythm(Duration period, std::vector<Eigen::MatrixXd> rate_matrices)
    : calendar_{period, static_cast<int>(rate_matrices.size())},
      rate_matrices_(std::move(rate_matrices)) {}

StatusOr<ChainRhythm> ChainRhythm::Make(Duration period,
                                        std::vector<Eigen::MatrixXd> rate_matrices) {
  if (period != kRhythmDay && period != kRhythmWeek) {
    return InvalidArgument("rhythm of {} s, expected a day or a week", ToSeconds(period));
  }
  if (rate_matrices.empty() || rate_matrices.size() > kMaxPhases) {
    return InvalidArgument(
        "rhythm of {} phases, expected 1 to {}", rate_matrices.size(), kMaxPhases);
  }
  for (std::size_t phase = 0; phase < rate_matrices.size(); ++phase) {
    Eigen::MatrixXd& rates = rate_matrices[phase];
    StatusOr<Eigen::MatrixXd> checked = CheckedRates(rates);
    if (!checked.ok()) {
      return InvalidArgument("rhythm, phase {}: {}", phase, Message(checked.status()));
    }
    if (rates.rows() != rate_matrices.front().rows()) {
      return InvalidArgument("rhythm, phase {}: {} states, expected {}",
                             phase,
                             rates.rows(),
                             rate_matrices.front().rows());
    }
    rates = *std::move(checked);
  }
  return ChainRhythm(period, std::move(rate_matrices));
}

// With P = I + Q / Λ, Λ the fastest rate of leaving, exp(Q t) = Σ_k Poisson(k; Λ t) P^k.
void ChainRhythm::AdvanceIn(int phase, double seconds, Eigen::MatrixXd* rows) const {
  const Eigen::MatrixXd& rates = rate_matrices_[static_cast<std::size_t>(phase)];
  const double fastest = -rates.diagonal().minCoeff();
  const double jumps = fastest * seconds;
  if (!(jumps > 0.0)) return;
  if (jumps > kMostJumps) {
    *rows = (*rows * StochasticExponential(rates, seconds)).eval();
    return;
  }
  double weight = std::exp(-jumps);
  Eigen::MatrixXd term = *rows;
  *rows *= weight;
  for (int k = 1; k < kMostTerms && (k < jumps || weight > kNegligible); ++k) {
    term += ((term * rates) / fastest).eval();
    weight *= jumps / k;
    *rows += weight * term;
  }
}

void ChainRhythm::Advance(Stamp from, Duration elapsed, Eigen::MatrixXd* rows) const {
  calendar_.ForEachPart(from, elapsed, [&](int phase, Duration length) {
    AdvanceIn(phase, ToSeconds(length), rows);
  });
  NormalizeRows(rows);
}

Eigen::MatrixXd ChainRhythm::Transition(Stamp from, Stamp to) const {
  Eigen::MatrixXd transition = Eigen::MatrixXd::Identity(states(), states());
  Duration elapsed = Elapsed(from, to);
  std::int64_t periods = elapsed / calendar_.period;
  if (periods >= kManyPeriods) {
    elapsed -= periods * calendar_.period;
    Eigen::MatrixXd power = transition;
    Advance(from, calendar_.period, &power);
    for (; periods > 0; periods /= 2) {
      if (periods % 2 == 1) transition = (transition * power).eval();
      power = (power * power).eval();
      NormalizeRows(&power);
    }
  }
  Advance(from, elapsed, &transition);
  return transition;
}

}  // namespace shiftmap
