// SPDX-License-Identifier: Apache-2.0
#include "localizer/hypothesis/visit.h"

#include <algorithm>

#include "localizer/hypothesis/log_math.h"
#include "mapstore/map/shift_report_check.h"

namespace shiftmap {
namespace {

// Observations in a row that overturn a decision.
constexpr int kMaxContradictions = 5;

}  // namespace

int Visit::Favourite() const {
  int favourite = 0;
  AsVector(log_prior).maxCoeff(&favourite);
  return favourite;
}

bool Visit::IsOverturnedBy(bool agrees) {
  contradictions = agrees ? 0 : contradictions + 1;
  return contradictions >= kMaxContradictions;
}

bool Visit::Settled() const {
  if (!decided || !confirmed) return false;
  for (std::size_t i = 0; i < given_up.size(); ++i) {
    const bool alive = !given_up[i];
    if (alive != (static_cast<int>(i) == *decided)) return false;
  }
  return true;
}

StateValues LogPosterior(const Visit& visit, const StateValues& log_alive) {
  StateValues log_p = log_alive;
  for (std::size_t i = 0; i < log_p.size(); ++i) {
    if (visit.given_up[i]) log_p[i] = *visit.given_up[i];
  }
  const double total = LogSumExp(AsVector(log_p));
  AsVector(log_p).array() -= total;
  return log_p;
}

VisitEvidence EvidenceOf(const Visit& visit,
                         const StateValues& log_posterior,
                         const LandmarkGroup& group) {
  VisitEvidence evidence;
  evidence.signature = group.signature;
  evidence.begin = visit.begin;
  evidence.end = visit.end;
  evidence.observations = visit.observations;
  const Eigen::VectorXd log_likelihood = AsVector(log_posterior) - AsVector(visit.log_prior);
  const double largest = log_likelihood.maxCoeff();
  evidence.modes.reserve(log_posterior.size());
  for (Eigen::Index i = 0; i < log_likelihood.size(); ++i) {
    evidence.modes.push_back({group.NumberOf(static_cast<int>(i)),
                              std::max(log_likelihood[i] - largest, -kMaxVisitLogRatio)});
  }
  return evidence;
}

}  // namespace shiftmap
