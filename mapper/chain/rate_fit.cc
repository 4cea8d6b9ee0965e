// SPDX-License-Identifier: Apache-2.0
#include "mapper/chain/rate_fit.h"

#include <Eigen/Eigenvalues>
#include <cmath>
#include <numbers>
#include <unsupported/Eigen/SpecialFunctions>
#include <utility>

#include "mapper/chain/chain_expectations.h"
#include "proto/core/check.h"

namespace shiftmap {
namespace {

// Where the parameter of a pair of states is in log_rates.
Eigen::Index ParameterOf(ChainStructure structure, int states, int from, int to) {
  if (structure == ChainStructure::kUniform) return 0;
  return static_cast<Eigen::Index>(from) * (states - 1) + (to < from ? to : to - 1);
}

Eigen::Index ParameterCount(ChainStructure structure, int states) {
  return structure == ChainStructure::kUniform ? 1
                                               : static_cast<Eigen::Index>(states) * (states - 1);
}

// The posterior over log x: value, gradient and what EM needs, at one point.
struct Evaluation {
  double log_likelihood = 0.0;
  double log_posterior = 0.0;
  Eigen::VectorXd jumps;     // Expected, per parameter.
  Eigen::VectorXd exposure;  // Expected time in which the parameter could jump. [s]
};

class Posterior {
 public:
  Posterior(const ChainSteps& steps, ChainStructure structure, const Gamma& prior)
      : steps_(steps), structure_(structure), prior_(prior) {}

  ModeChain Chain(const Eigen::VectorXd& log_rates) const {
    const int n = steps_.states;
    if (structure_ == ChainStructure::kUniform) {
      return ModeChain::Uniform(n - 1, std::exp(log_rates(0)));
    }
    Eigen::MatrixXd rates = Eigen::MatrixXd::Zero(n, n);
    for (int from = 0; from < n; ++from) {
      for (int to = 0; to < n; ++to) {
        if (from == to) continue;
        rates(from, to) = std::exp(log_rates(ParameterOf(structure_, n, from, to))) / (n - 1);
      }
    }
    rates.diagonal() = -rates.rowwise().sum();
    StatusOr<ModeChain> chain = ModeChain::FromRates(rates);
    SHIFTMAP_CHECK(chain.ok(), "rates of a fit: {}", chain.status().ToString());
    return *std::move(chain);
  }

  Evaluation Evaluate(const Eigen::VectorXd& log_rates) const {
    const int n = steps_.states;
    const ModeChain chain = Chain(log_rates);
    const ChainExpectations expected = ExpectChain(steps_, {chain});
    const Eigen::MatrixXd& integral = expected.integrals.front();
    Evaluation result;
    result.log_likelihood = expected.log_likelihood;
    result.log_posterior = expected.log_likelihood;
    for (const double log_rate : log_rates) {
      result.log_posterior += prior_.LogDensityOfLog(log_rate);
    }
    result.jumps = Eigen::VectorXd::Zero(log_rates.size());
    result.exposure = Eigen::VectorXd::Zero(log_rates.size());
    for (int from = 0; from < n; ++from) {
      for (int to = 0; to < n; ++to) {
        if (from == to) continue;
        const Eigen::Index i = ParameterOf(structure_, n, from, to);
        result.jumps(i) += chain.rate_matrix()(from, to) * integral(from, to);
        result.exposure(i) += integral(from, from) / (n - 1);
      }
    }
    return result;
  }

  // One step of EM.
  Eigen::VectorXd Maximize(const Evaluation& at) const {
    return ((prior_.shape + at.jumps.array()) / (prior_.exposure_s + at.exposure.array())).log();
  }

  // d log posterior / d log x.
  Eigen::VectorXd Gradient(const Eigen::VectorXd& log_rates) const {
    const Evaluation at = Evaluate(log_rates);
    return prior_.shape + at.jumps.array() -
           log_rates.array().exp() * (prior_.exposure_s + at.exposure.array());
  }

 private:
  const ChainSteps& steps_;
  ChainStructure structure_;
  Gamma prior_;
};

// Minus the Hessian of the posterior, by central differences.
Eigen::MatrixXd Information(const Posterior& posterior, const Eigen::VectorXd& log_rates) {
  constexpr double kStep = 1e-3;
  const Eigen::Index count = log_rates.size();
  Eigen::MatrixXd information(count, count);
  Eigen::VectorXd moved = log_rates;
  for (Eigen::Index i = 0; i < count; ++i) {
    moved(i) = log_rates(i) + kStep;
    const Eigen::VectorXd above = posterior.Gradient(moved);
    moved(i) = log_rates(i) - kStep;
    information.col(i) = (posterior.Gradient(moved) - above) / (2.0 * kStep);
    moved(i) = log_rates(i);
  }
  return 0.5 * (information + information.transpose());
}

// Covariance and Laplace's integral.
void Conclude(const Posterior& posterior, const Gamma& prior, double log_posterior, RateFit* fit) {
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(
      Information(posterior, fit->log_rates));
  const Eigen::VectorXd values = solver.eigenvalues().cwiseMax(0.1 * prior.shape);
  fit->covariance = solver.eigenvectors() * values.cwiseInverse().asDiagonal() *
                    solver.eigenvectors().transpose();
  fit->log_marginal =
      log_posterior + 0.5 * (std::log(2.0 * std::numbers::pi) - values.array().log()).sum();
  // A Gamma distribution is wider than Laplace has it: Γ(s) against Stirling's. So the integral is
  // exact for a chain seen at every time.
  for (Eigen::Index i = 0; i < fit->log_rates.size(); ++i) {
    const double shape = 1.0 / fit->covariance(i, i);
    fit->log_marginal += Eigen::numext::lgamma(shape) - (shape - 0.5) * std::log(shape) + shape -
                         0.5 * std::log(2.0 * std::numbers::pi);
  }
}

}  // namespace

Gamma RateFit::Posterior(Eigen::Index i) const {
  const double shape = 1.0 / covariance(i, i);
  return {shape, shape / std::exp(log_rates(i))};
}

Gamma RateFit::PosteriorOfRate(int from, int to) const {
  SHIFTMAP_CHECK(from != to, "rate from {} to itself", from);
  Gamma gamma = Posterior(ParameterOf(structure, chain.states(), from, to));
  gamma.exposure_s *= chain.states() - 1;
  return gamma;
}

Gamma RateFit::PosteriorOfLeaveRate() const {
  const Eigen::VectorXd rates = log_rates.array().exp();
  const double mean = rates.mean();
  const Eigen::VectorXd gradient = rates / static_cast<double>(rates.size());
  const double variance = gradient.dot(covariance * gradient);
  return {mean * mean / variance, mean / variance};
}

RateFit FitRates(const ChainSteps& steps,
                 ChainStructure structure,
                 const Gamma& prior,
                 const RateFitOptions& options,
                 const std::optional<Eigen::VectorXd>& given_start) {
  SHIFTMAP_CHECK(
      steps.states >= 2 && steps.phases == 1, "{} states, {} phases", steps.states, steps.phases);
  const Posterior posterior(steps, structure, prior);
  RateFit fit;
  fit.structure = structure;
  const Eigen::Index count = ParameterCount(structure, steps.states);
  Eigen::VectorXd start =
      given_start.value_or(Eigen::VectorXd::Constant(count, std::log(prior.mean())));
  SHIFTMAP_CHECK(start.size() == count, "start of {} parameters, expected {}", start.size(), count);
  Evaluation at = posterior.Evaluate(start);
  while (fit.iterations < options.max_iterations && !fit.converged) {
    const Eigen::VectorXd once = posterior.Maximize(at);
    const Evaluation at_once = posterior.Evaluate(once);
    const Eigen::VectorXd twice = posterior.Maximize(at_once);
    const Eigen::VectorXd first = once - start;
    const Eigen::VectorXd bend = (twice - once) - first;
    fit.converged = (twice - once).cwiseAbs().maxCoeff() < options.tolerance;
    fit.iterations += 2;
    start = twice;
    at = posterior.Evaluate(start);
    if (fit.converged || !(bend.norm() > 0.0)) continue;
    const double length = first.norm() / bend.norm();
    if (!(length > 1.0)) continue;
    const Eigen::VectorXd far = once - first + 2.0 * length * first + length * length * bend;
    // Beyond e^20 an extrapolation is none.
    if ((far - start).cwiseAbs().maxCoeff() > 20.0) continue;
    const Evaluation at_far = posterior.Evaluate(far);
    ++fit.iterations;
    if (!(at_far.log_posterior >= at.log_posterior)) continue;
    start = far;
    at = at_far;
  }
  fit.log_rates = start;
  fit.chain = posterior.Chain(start);
  fit.log_likelihood = at.log_likelihood;
  fit.jumps = at.jumps.sum();
  for (const int gap : steps.gap_of_step) {
    if (gap >= 0) fit.seconds += ToSeconds(steps.gaps[static_cast<std::size_t>(gap)].length);
  }
  Conclude(posterior, prior, at.log_posterior, &fit);
  return fit;
}

}  // namespace shiftmap
