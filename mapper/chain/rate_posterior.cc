// SPDX-License-Identifier: Apache-2.0
#include "mapper/chain/rate_posterior.h"

#include <cmath>
#include <utility>

#include "mapper/chain/chain_expectations.h"

namespace shiftmap {
namespace {

// Farther off a quadratic model says nothing.
constexpr double kLongestStep = 2.0;

// The inverse curvature after a step along which the gradient fell by `fall` (BFGS).
void Update(const Eigen::VectorXd& step, const Eigen::VectorXd& fall, Eigen::MatrixXd* covariance) {
  const double curvature = step.dot(fall);
  if (!(curvature > 1e-10 * step.norm() * fall.norm())) return;
  const Eigen::VectorXd scaled = *covariance * fall;
  *covariance += (1.0 + fall.dot(scaled) / curvature) / curvature * step * step.transpose() -
                 (scaled * step.transpose() + step * scaled.transpose()) / curvature;
}

}  // namespace

Eigen::MatrixXd RatePosterior::Rates(const Eigen::VectorXd& log_rates) const {
  const int n = steps_.states;
  Eigen::MatrixXd rates = Eigen::MatrixXd::Zero(n, n);
  for (int from = 0; from < n; ++from) {
    for (int to = 0; to < n; ++to) {
      if (from != to) rates(from, to) = std::exp(log_rates(ParameterOf(n, from, to))) / (n - 1);
    }
  }
  rates.diagonal() = -rates.rowwise().sum();
  return rates;
}

RatePoint RatePosterior::Evaluate(const Eigen::VectorXd& log_rates) const {
  const int n = steps_.states;
  const Eigen::MatrixXd rates = Rates(log_rates);
  const ChainExpectations expected = ExpectChain(steps_, {rates});
  const Eigen::MatrixXd& integral = expected.integrals.front();
  RatePoint at;
  at.log_rates = log_rates;
  at.log_likelihood = expected.log_likelihood;
  at.log_posterior = expected.log_likelihood;
  at.jumps.resize(log_rates.size());
  at.exposure.resize(log_rates.size());
  for (int from = 0; from < n; ++from) {
    for (int to = 0; to < n; ++to) {
      if (from == to) continue;
      const Eigen::Index i = ParameterOf(n, from, to);
      at.jumps(i) = rates(from, to) * integral(from, to);
      at.exposure(i) = integral(from, from) / (n - 1);
      at.log_posterior += prior_.LogDensityOfLog(log_rates(i));
    }
  }
  at.gradient = prior_.shape + at.jumps.array() -
                log_rates.array().exp() * (prior_.exposure_s + at.exposure.array());
  return at;
}

Eigen::VectorXd RatePosterior::Maximize(const RatePoint& at) const {
  return ((prior_.shape + at.jumps.array()) / (prior_.exposure_s + at.exposure.array())).log();
}

Eigen::MatrixXd RatePosterior::CompleteCovariance(const RatePoint& at) const {
  return (prior_.shape + at.jumps.array()).inverse().matrix().asDiagonal();
}

void RatePosterior::Climb(double distance,
                          RatePoint* at,
                          Eigen::MatrixXd* covariance,
                          int* evaluations) const {
  while (*evaluations > 0) {
    Eigen::VectorXd step = *covariance * at->gradient;
    if (!(step.dot(at->gradient) > 0.0)) {
      *covariance = CompleteCovariance(*at);
      step = *covariance * at->gradient;
    }
    const double length = step.cwiseAbs().maxCoeff();
    if (!(length > distance)) return;
    if (length > kLongestStep) step *= kLongestStep / length;
    RatePoint next = Evaluate(at->log_rates + step);
    --*evaluations;
    if (next.log_posterior >= at->log_posterior) {
      Update(step, at->gradient - next.gradient, covariance);
      *at = std::move(next);
      continue;
    }
    next = Evaluate(Maximize(*at));
    --*evaluations;
    const bool rises = next.log_posterior > at->log_posterior;
    if (rises) *at = std::move(next);
    *covariance = CompleteCovariance(*at);
    if (!rises) return;
  }
}

Eigen::MatrixXd RatePosterior::Information(const RatePoint& at, int* evaluations) const {
  constexpr double kStep = 2e-5;
  const Eigen::Index count = at.log_rates.size();
  Eigen::MatrixXd information(count, count);
  Eigen::VectorXd moved = at.log_rates;
  for (Eigen::Index i = 0; i < count; ++i) {
    moved(i) = at.log_rates(i) + kStep;
    information.col(i) = (at.gradient - Evaluate(moved).gradient) / kStep;
    moved(i) = at.log_rates(i);
  }
  *evaluations -= static_cast<int>(count);
  return 0.5 * (information + information.transpose());
}

}  // namespace shiftmap
