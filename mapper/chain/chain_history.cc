// SPDX-License-Identifier: Apache-2.0
#include "mapper/chain/chain_history.h"

#include <algorithm>
#include <utility>

#include "proto/core/check.h"

namespace shiftmap {

ChainHistory MakeChainHistory(const LandmarkGroup& group, std::vector<EvidenceRow> rows) {
  ChainHistory history{group.signature, group.chain.states(), {}};
  Eigen::VectorXd values;
  for (const EvidenceRow& row : InOrder(std::move(rows))) {
    if (!StateLogLikelihoods(group, row.evidence.modes, &values)) continue;
    const Stamp end = std::max(row.evidence.begin, row.evidence.end);
    if (!history.visits.empty() && row.evidence.begin <= history.visits.back().end) {
      ChainVisit& visit = history.visits.back();
      visit.log_likelihoods += values;
      visit.end = std::max(visit.end, end);
    } else {
      history.visits.push_back({row.evidence.begin, end, values});
    }
  }
  return history;
}

ChainHistory AllowMistakes(ChainHistory history, double share) {
  SHIFTMAP_CHECK(share >= 0.0 && share < 1.0, "share of mistakes {}", share);
  if (share == 0.0) return history;
  for (ChainVisit& visit : history.visits) {
    const double largest = visit.log_likelihoods.maxCoeff();
    Eigen::ArrayXd likelihoods = (visit.log_likelihoods.array() - largest).exp();
    likelihoods *= (1.0 - share) / likelihoods.sum();
    visit.log_likelihoods = (likelihoods + share / history.states).log();
  }
  return history;
}

ChainHistory FirstVisits(const ChainHistory& history, std::size_t visits) {
  SHIFTMAP_CHECK(visits <= history.visits.size(), "{} of {} visits", visits, history.visits.size());
  const auto begin = history.visits.begin();
  return {history.signature, history.states, {begin, begin + static_cast<std::ptrdiff_t>(visits)}};
}

Status CheckHistory(const ChainHistory& history) {
  const std::string& name = history.signature.text();
  if (history.states < 1) {
    return InvalidArgument("chain history of '{}': {} states", name, history.states);
  }
  for (std::size_t i = 0; i < history.visits.size(); ++i) {
    const ChainVisit& visit = history.visits[i];
    if (visit.end < visit.begin || (i > 0 && visit.begin <= history.visits[i - 1].end)) {
      return InvalidArgument("chain history of '{}': visit {} out of order", name, i);
    }
    if (visit.log_likelihoods.size() != history.states) {
      return InvalidArgument("chain history of '{}': visit {} has {} log-likelihoods, expected {}",
                             name,
                             i,
                             visit.log_likelihoods.size(),
                             history.states);
    }
    if (!visit.log_likelihoods.allFinite()) {
      return InvalidArgument(
          "chain history of '{}': visit {} has a log-likelihood that is not finite", name, i);
    }
  }
  return OkStatus();
}

}  // namespace shiftmap
