// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/mode_filter.h"

#include <algorithm>
#include <cmath>
#include <tuple>

#include "proto/core/check.h"

namespace shiftmap {
namespace {

auto OrderOf(const EvidenceRow& row) {
  return std::tie(row.evidence.begin, row.evidence.end, row.report_uuid);
}

// Log-likelihoods by state of the group. [nat]
Eigen::VectorXd StateLogLikelihoods(const LandmarkGroup& group, const VisitEvidence& evidence) {
  SHIFTMAP_CHECK(!evidence.modes.empty() && evidence.modes.front().mode == kAbsent,
                 "evidence of '{}' does not name absent",
                 evidence.signature.text());
  const double absent = evidence.modes.front().log_likelihood;
  Eigen::VectorXd values = Eigen::VectorXd::Constant(group.chain.states(), absent);
  for (const VisitEvidence::ModeLogLikelihood& mode : evidence.modes) {
    const int state = group.StateOf(mode.mode);
    if (state >= 0) values(state) = mode.log_likelihood;
  }
  return values;
}

// Eigen's vectorized exp(-inf) is a denormal number; an impossible mode must stay at exactly 0.
Eigen::VectorXd Exp(const Eigen::VectorXd& values) {
  return values.unaryExpr([](double value) { return std::exp(value); });
}

Eigen::VectorXd Log(const Eigen::VectorXd& values) {
  return values.unaryExpr([](double value) { return std::log(value); });
}

// Subtracts log Σ exp.
void Normalize(Eigen::VectorXd& log_probabilities) {
  const double largest = log_probabilities.maxCoeff();
  log_probabilities.array() -= largest;
  log_probabilities.array() -= std::log(Exp(log_probabilities).sum());
}

}  // namespace

// Works on logarithms: evidence of overlapping visits may exclude a mode beyond what a double can
// hold and bring it back before any time passes.
ModeState FilterModes(const LandmarkGroup& group, Stamp stamp, std::vector<EvidenceRow> rows) {
  std::sort(rows.begin(), rows.end(), [](const EvidenceRow& a, const EvidenceRow& b) {
    return OrderOf(a) < OrderOf(b);
  });
  if (rows.empty()) return {group.probabilities, stamp};
  Eigen::VectorXd log_probabilities = Log(group.probabilities);
  const EvidenceRow* previous = nullptr;
  for (const EvidenceRow& row : rows) {
    if (previous != nullptr && OrderOf(*previous) == OrderOf(row)) continue;
    previous = &row;
    if (row.evidence.begin > stamp && group.chain.leave_rate_per_s() > 0.0) {
      const Duration elapsed = row.evidence.begin - stamp;
      log_probabilities = Log(group.chain.Propagate(Exp(log_probabilities), elapsed));
    }
    log_probabilities += StateLogLikelihoods(group, row.evidence);
    Normalize(log_probabilities);
    stamp = std::max(stamp, row.evidence.end);
  }
  return {Exp(log_probabilities), stamp};
}

Eigen::VectorXd PropagateModes(const LandmarkGroup& group, const ModeState& state, Stamp at) {
  if (at <= state.stamp) return state.probabilities;
  return group.chain.Propagate(state.probabilities, at - state.stamp);
}

}  // namespace shiftmap
