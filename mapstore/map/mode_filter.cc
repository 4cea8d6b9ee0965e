// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/mode_filter.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <limits>
#include <tuple>
#include <utility>

#include "proto/core/check.h"

namespace shiftmap {
namespace {

constexpr double kImpossible = -std::numeric_limits<double>::infinity();

// Long against the time between any two changes, short enough not to overflow.
constexpr Duration kForever = std::chrono::hours(24 * 365 * 200);

// Zero for what is not later. Stores of older versions have stamps further apart than a Duration
// can say.
Duration Elapsed(Stamp from, Stamp to) {
  if (to <= from) return Duration::zero();
  const auto elapsed_ns = static_cast<std::uint64_t>(ToNanoseconds(to)) -
                          static_cast<std::uint64_t>(ToNanoseconds(from));
  return Duration(static_cast<std::int64_t>(
      std::min(elapsed_ns, static_cast<std::uint64_t>(kForever.count()))));
}

auto OrderOf(const EvidenceRow& row) {
  return std::tie(row.evidence.begin, row.evidence.end, row.source);
}

// Eigen's vectorized exp(-inf) is a denormal number; an impossible mode must stay at exactly 0.
Eigen::VectorXd Exp(const Eigen::VectorXd& values) {
  return values.unaryExpr([](double value) { return std::exp(value); });
}

Eigen::VectorXd Log(const Eigen::VectorXd& values) {
  return values.unaryExpr([](double value) { return std::log(value); });
}

// Subtracts log Σ exp. Nothing left to normalize stays as it is.
void Normalize(Eigen::VectorXd* log_probabilities) {
  const double largest = log_probabilities->maxCoeff();
  if (largest == kImpossible) return;
  double sum = 0.0;
  for (double& value : *log_probabilities) {
    value -= largest;
    sum += std::exp(value);
  }
  log_probabilities->array() -= std::log(sum);
}

}  // namespace

bool FavoursKnownMode(const LandmarkGroup& group,
                      const std::vector<VisitEvidence::ModeLogLikelihood>& evidence) {
  double known = kImpossible;
  double unknown = kImpossible;
  for (const VisitEvidence::ModeLogLikelihood& mode : evidence) {
    double& side = group.CarriedStateOf(mode.mode) >= 0 ? known : unknown;
    side = std::max(side, mode.log_likelihood);
  }
  return unknown <= known;
}

bool StateLogLikelihoods(const LandmarkGroup& group,
                         const std::vector<VisitEvidence::ModeLogLikelihood>& evidence,
                         Eigen::VectorXd* values) {
  SHIFTMAP_CHECK(!evidence.empty() && evidence.front().mode == kAbsent,
                 "evidence of '{}' does not name absent",
                 group.signature.text());
  values->setConstant(group.chain.states(), kImpossible);
  for (const VisitEvidence::ModeLogLikelihood& mode : evidence) {
    const int state = group.CarriedStateOf(mode.mode);
    if (state >= 0) (*values)(state) = std::max((*values)(state), mode.log_likelihood);
  }
  for (double& value : *values) {
    if (value == kImpossible) value = evidence.front().log_likelihood;
  }
  return FavoursKnownMode(group, evidence);
}

ModeState StartModes(const LandmarkGroup& group, Stamp stamp) {
  return {Log(group.probabilities), stamp, false};
}

// Works on logarithms: evidence of overlapping visits may exclude a mode beyond what a double can
// hold and bring it back before any time passes.
void AddVisit(const LandmarkGroup& group,
              Stamp begin,
              Stamp end,
              const Eigen::VectorXd& log_likelihoods,
              ModeState* state) {
  if (!state->started) state->stamp = std::min(state->stamp, begin);
  state->started = true;
  if (begin > state->stamp && group.chain.leave_rate_per_s() > 0.0) {
    state->log_probabilities =
        Log(group.chain.Propagate(Exp(state->log_probabilities), Elapsed(state->stamp, begin)));
  }
  state->log_probabilities += log_likelihoods;
  Normalize(&state->log_probabilities);
  state->stamp = std::max(state->stamp, end);
}

Eigen::VectorXd CarriedProbabilities(const LandmarkGroup& group,
                                     const std::vector<StatedMode>& stated) {
  SHIFTMAP_CHECK(!stated.empty(), "nothing is stated of '{}'", group.signature.text());
  Eigen::VectorXd probabilities = Eigen::VectorXd::Zero(group.chain.states());
  std::vector<bool> named(static_cast<std::size_t>(group.chain.states()));
  for (const StatedMode& mode : stated) {
    const int state = group.CarriedStateOf(mode.number);
    if (state < 0) continue;
    probabilities(state) += mode.probability;
    named[static_cast<std::size_t>(state)] = true;
  }
  for (std::size_t state = 0; state < named.size(); ++state) {
    if (named[state]) continue;
    probabilities(static_cast<Eigen::Index>(state)) = stated.front().probability;
  }
  return probabilities;
}

void AddStatement(const LandmarkGroup& group,
                  const Eigen::VectorXd& probabilities,
                  Stamp stamp,
                  ModeState* state) {
  const Eigen::VectorXd stationary = StationaryStart(group, stamp).log_probabilities;
  Eigen::VectorXd ratio = Log(probabilities);
  for (Eigen::Index i = 0; i < ratio.size(); ++i) {
    if (stationary(i) != kImpossible) ratio(i) -= stationary(i);
  }
  ModeState stated = *state;
  AddVisit(group, stamp, stamp, ratio, &stated);
  // What excludes all that is stated says that one of the two is wrong: not which.
  if (stated.log_probabilities.maxCoeff() != kImpossible) *state = std::move(stated);
}

ModeState StationaryStart(const LandmarkGroup& group, Stamp stamp) {
  const Eigen::VectorXd uniform =
      Eigen::VectorXd::Constant(group.chain.states(), 1.0 / group.chain.states());
  if (group.chain.leave_rate_per_s() == 0.0) return {Log(uniform), stamp, false};
  return {Log(group.chain.Propagate(uniform, kForever)), stamp, false};
}

std::vector<EvidenceRow> InOrder(std::vector<EvidenceRow> rows) {
  std::sort(rows.begin(), rows.end(), [](const EvidenceRow& a, const EvidenceRow& b) {
    return OrderOf(a) < OrderOf(b);
  });
  const auto end = std::unique(rows.begin(), rows.end(), [](const auto& a, const auto& b) {
    return OrderOf(a) == OrderOf(b);
  });
  rows.erase(end, rows.end());
  return rows;
}

ModeState FilterModes(const LandmarkGroup& group, ModeState start, std::vector<EvidenceRow> rows) {
  Eigen::VectorXd log_likelihoods;
  for (const EvidenceRow& row : InOrder(std::move(rows))) {
    if (!StateLogLikelihoods(group, row.evidence.modes, &log_likelihoods)) continue;
    AddVisit(group, row.evidence.begin, row.evidence.end, log_likelihoods, &start);
  }
  return start;
}

Eigen::VectorXd ProbabilitiesAt(const LandmarkGroup& group, const ModeState& state, Stamp at) {
  const Eigen::VectorXd probabilities = Exp(state.log_probabilities);
  if (at <= state.stamp) return probabilities;
  return group.chain.Propagate(probabilities, Elapsed(state.stamp, at));
}

}  // namespace shiftmap
