// SPDX-License-Identifier: Apache-2.0
#include "mapper/chain/rate_fit.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <unsupported/Eigen/SpecialFunctions>
#include <utility>

#include "mapper/chain/rate_posterior.h"
#include "mapper/chain/uniform_likelihood.h"
#include "proto/core/check.h"

namespace shiftmap {
namespace {

// When the search for the rates ends.
constexpr int kMaxEvaluations = 500;     // Of the history.
constexpr double kRateTolerance = 1e-7;  // Relative error of a rate, about.

double SecondsOf(const ChainSteps& steps) {
  double seconds = 0.0;
  for (const int gap : steps.gap_of_step) {
    if (gap >= 0) seconds += ToSeconds(steps.gaps[static_cast<std::size_t>(gap)].length);
  }
  return seconds;
}

// A tenth of the prior's shape, the least curvature that a direction counts with.
double LeastCurvature(const Gamma& prior) { return 0.1 * prior.shape; }

// Covariance and Laplace's integral, from the posterior's curvature.
void Conclude(const Eigen::MatrixXd& information,
              const Gamma& prior,
              double log_posterior,
              RateFit* fit) {
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(information);
  const Eigen::VectorXd values = solver.eigenvalues().cwiseMax(LeastCurvature(prior));
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

// The posterior of the one rate of a uniform chain, at one point.
struct UniformPoint {
  UniformPoint(const ChainSteps& steps, const Gamma& prior, double seconds, double at)
      : log_rate(at), likelihood(EvaluateUniform(steps, at)) {
    const double rate = std::exp(at);
    jumps = likelihood.slope + rate * seconds;
    log_posterior = likelihood.value + prior.LogDensityOfLog(at);
    slope = likelihood.slope + prior.shape - rate * prior.exposure_s;
    curvature = rate * prior.exposure_s - likelihood.curvature;
    em_step = std::log((prior.shape + std::max(0.0, jumps)) / (prior.exposure_s + seconds)) - at;
  }

  double log_rate = 0.0;
  UniformLikelihood likelihood;
  double jumps = 0.0;  // Expected.
  double log_posterior = 0.0;
  double slope = 0.0;
  double curvature = 0.0;  // Minus the second derivative.
  double em_step = 0.0;    // Never lowers the posterior.
};

// Climbs until a step is no longer than `distance`.
UniformPoint ClimbUniform(
    const ChainSteps& steps, const Gamma& prior, double start, double distance, int* evaluations) {
  const double seconds = SecondsOf(steps);
  UniformPoint at(steps, prior, seconds, start);
  --*evaluations;
  while (*evaluations > 0) {
    const bool is_near =
        at.curvature > LeastCurvature(prior) && std::abs(at.slope) < 2.0 * at.curvature;
    const double step = is_near ? at.slope / at.curvature : at.em_step;
    if (std::abs(step) <= distance) break;
    UniformPoint next(steps, prior, seconds, at.log_rate + step);
    --*evaluations;
    if (is_near && next.log_posterior < at.log_posterior) {
      // Where both agree to the last digits, this was the top.
      if (std::abs(at.em_step) <= distance) break;
      next = UniformPoint(steps, prior, seconds, at.log_rate + at.em_step);
      --*evaluations;
    }
    at = next;
  }
  return at;
}

RateFit FitUniform(const ChainSteps& steps, const Gamma& prior, double start) {
  RateFit fit;
  int evaluations = kMaxEvaluations;
  const UniformPoint at = ClimbUniform(steps, prior, start, kRateTolerance, &evaluations);
  fit.converged = evaluations > 0;
  fit.iterations = kMaxEvaluations - evaluations;
  fit.log_rates = Eigen::VectorXd::Constant(1, at.log_rate);
  fit.chain = ModeChain::Uniform(steps.states - 1, std::exp(at.log_rate));
  fit.log_likelihood = at.likelihood.value;
  fit.jumps = at.jumps;
  Conclude(Eigen::MatrixXd::Constant(1, 1, at.curvature), prior, at.log_posterior, &fit);
  return fit;
}

// The estimate of a quasi-Newton method is no closer than this share of what it is asked for.
constexpr double kShareOfDistance = 0.3;

RateFit FitGeneral(const ChainSteps& steps, const Gamma& prior, const RateStart& start) {
  RateFit fit;
  fit.structure = ChainStructure::kGeneral;
  const RatePosterior posterior(steps, prior);
  // Newton's step squares the distance.
  const double distance = std::sqrt(kRateTolerance);
  int evaluations = kMaxEvaluations;
  RatePoint at = posterior.Evaluate(start.log_rates);
  --evaluations;
  Eigen::MatrixXd covariance = start.covariance;
  if (covariance.size() == 0) {
    at = posterior.Evaluate(posterior.Maximize(at));
    --evaluations;
    covariance = posterior.CompleteCovariance(at);
  }
  do {
    posterior.Climb(kShareOfDistance * distance, &at, &covariance, &evaluations);
    fit.log_rates = at.log_rates;
    Conclude(posterior.Information(at, &evaluations), prior, at.log_posterior, &fit);
    covariance = fit.covariance;
    const Eigen::VectorXd step = covariance * at.gradient;
    fit.converged = step.cwiseAbs().maxCoeff() <= distance;
    if (!fit.converged) continue;
    RatePoint top = posterior.Evaluate(at.log_rates + step);
    --evaluations;
    if (top.log_posterior < at.log_posterior) continue;
    fit.log_marginal += top.log_posterior - at.log_posterior;
    at = std::move(top);
  } while (!fit.converged && evaluations > 0);
  fit.iterations = kMaxEvaluations - evaluations;
  fit.log_rates = at.log_rates;
  StatusOr<ModeChain> chain = ModeChain::FromRates(posterior.Rates(at.log_rates));
  SHIFTMAP_CHECK(chain.ok(), "rates of a fit: {}", chain.status().ToString());
  fit.chain = *std::move(chain);
  fit.log_likelihood = at.log_likelihood;
  fit.jumps = at.jumps.sum();
  return fit;
}

RateStart StartOf(const ChainSteps& steps,
                  ChainStructure structure,
                  const Gamma& prior,
                  const std::optional<RateStart>& given) {
  SHIFTMAP_CHECK(
      steps.states >= 2 && steps.phases == 1, "{} states, {} phases", steps.states, steps.phases);
  const Eigen::Index count = structure == ChainStructure::kUniform
                                 ? 1
                                 : static_cast<Eigen::Index>(steps.states) * (steps.states - 1);
  if (!given) return {Eigen::VectorXd::Constant(count, std::log(prior.mean())), {}};
  SHIFTMAP_CHECK(given->log_rates.size() == count,
                 "start of {} parameters, expected {}",
                 given->log_rates.size(),
                 count);
  return *given;
}

}  // namespace

Gamma RateFit::Posterior(Eigen::Index i) const {
  const double shape = 1.0 / covariance(i, i);
  return {shape, shape / std::exp(log_rates(i))};
}

Gamma RateFit::PosteriorOfRate(int from, int to) const {
  SHIFTMAP_CHECK(from != to, "rate from {} to itself", from);
  Gamma gamma = Posterior(structure == ChainStructure::kUniform
                              ? 0
                              : RatePosterior::ParameterOf(chain.states(), from, to));
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
                 const std::optional<RateStart>& given_start) {
  const RateStart start = StartOf(steps, structure, prior, given_start);
  RateFit fit = structure == ChainStructure::kUniform ? FitUniform(steps, prior, start.log_rates(0))
                                                      : FitGeneral(steps, prior, start);
  fit.seconds = SecondsOf(steps);
  return fit;
}

Eigen::MatrixXd MostProbableRates(const ChainSteps& steps,
                                  ChainStructure structure,
                                  const Gamma& prior,
                                  const std::optional<RateStart>& given_start) {
  const RateStart start = StartOf(steps, structure, prior, given_start);
  int evaluations = kMaxEvaluations;
  if (structure == ChainStructure::kUniform) {
    const double log_rate =
        ClimbUniform(steps, prior, start.log_rates(0), kRateTolerance, &evaluations).log_rate;
    return ModeChain::Uniform(steps.states - 1, std::exp(log_rate)).rate_matrix();
  }
  const RatePosterior posterior(steps, prior);
  RatePoint at = posterior.Evaluate(start.log_rates);
  Eigen::MatrixXd covariance =
      start.covariance.size() > 0 ? start.covariance : posterior.CompleteCovariance(at);
  posterior.Climb(kShareOfDistance * std::sqrt(kRateTolerance), &at, &covariance, &evaluations);
  return posterior.Rates(at.log_rates);
}

}  // namespace shiftmap
