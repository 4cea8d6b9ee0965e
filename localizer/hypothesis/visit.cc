// SPDX-License-Identifier: Apache-2.0
#include "localizer/hypothesis/visit.h"

#include <algorithm>

#include "localizer/hypothesis/log_math.h"

namespace shiftmap {
namespace {

constexpr double kMinLogLikelihood = -50.0;

}  // namespace

Eigen::VectorXd LogPosterior(const Visit& visit, const Eigen::VectorXd& log_alive) {
  Eigen::VectorXd log_p = log_alive;
  for (Eigen::Index i = 0; i < log_p.size(); ++i) {
    const std::optional<double>& given_up = visit.given_up[static_cast<std::size_t>(i)];
    if (given_up) log_p[i] = *given_up;
  }
  return log_p.array() - LogSumExp(log_p);
}

VisitEvidence EvidenceOf(const Visit& visit,
                         const Eigen::VectorXd& log_posterior,
                         const LandmarkGroup& group) {
  VisitEvidence evidence;
  evidence.signature = group.signature;
  evidence.begin = visit.begin;
  evidence.end = visit.end;
  evidence.observations = visit.observations;
  const Eigen::VectorXd log_likelihood = log_posterior - visit.log_prior;
  const double largest = log_likelihood.maxCoeff();
  for (Eigen::Index i = 0; i < log_likelihood.size(); ++i) {
    evidence.modes.push_back({group.NumberOf(static_cast<int>(i)),
                              std::max(log_likelihood[i] - largest, kMinLogLikelihood)});
  }
  return evidence;
}

}  // namespace shiftmap
