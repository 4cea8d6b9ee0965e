// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/mode_chain.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <unsupported/Eigen/MatrixFunctions>
#include <utility>

#include "proto/core/check.h"

namespace shiftmap {
namespace {

// Long against the time between any two changes, short enough not to overflow.
constexpr Duration kForever = std::chrono::hours(24 * 365 * 200);

// exp(Q t) by scaling and squaring, with rows that are distributions to the last bit.
Eigen::MatrixXd StochasticExponential(const Eigen::MatrixXd& rates, double seconds) {
  const auto normalize = [](Eigen::MatrixXd& matrix) {
    matrix = matrix.cwiseMax(0.0).eval();
    for (Eigen::Index row = 0; row < matrix.rows(); ++row) matrix.row(row) /= matrix.row(row).sum();
  };
  // Squaring here and not in the library: rounding would grow over the hundred squarings of years
  // at a rate of seconds.
  int squarings = 0;
  double step = seconds;
  const double fastest = -rates.diagonal().minCoeff();
  while (step * fastest > 1.0) {
    step *= 0.5;
    ++squarings;
  }
  Eigen::MatrixXd transition = (rates * step).exp();
  normalize(transition);
  for (; squarings > 0; --squarings) {
    transition = (transition * transition).eval();
    normalize(transition);
  }
  return transition;
}

}  // namespace

ModeChain::ModeChain(Eigen::MatrixXd rate_matrix, double leave_rate_per_s)
    : rate_matrix_(std::move(rate_matrix)), leave_rate_per_s_(leave_rate_per_s) {
  const Eigen::Index states = rate_matrix_.rows();
  stationary_.setConstant(states, 1.0 / static_cast<double>(states));
}

ModeChain ModeChain::Uniform(int modes, double leave_rate_per_s) {
  SHIFTMAP_CHECK(
      modes >= 0 && leave_rate_per_s >= 0.0, "modes {}, leave rate {}", modes, leave_rate_per_s);
  const int states = modes + 1;
  if (modes == 0) return ModeChain(Eigen::MatrixXd::Zero(1, 1), leave_rate_per_s);
  Eigen::MatrixXd rates = Eigen::MatrixXd::Constant(states, states, leave_rate_per_s / modes);
  rates.diagonal().setConstant(-leave_rate_per_s);
  return ModeChain(std::move(rates), leave_rate_per_s);
}

StatusOr<ModeChain> ModeChain::FromRates(const Eigen::MatrixXd& rate_matrix) {
  if (rate_matrix.rows() < 1 || rate_matrix.rows() != rate_matrix.cols()) {
    return InvalidArgument(
        "rate matrix of {} x {}, expected square", rate_matrix.rows(), rate_matrix.cols());
  }
  Eigen::MatrixXd rates = rate_matrix;
  rates.diagonal().setZero();
  for (Eigen::Index row = 0; row < rates.rows(); ++row) {
    for (Eigen::Index column = 0; column < rates.cols(); ++column) {
      if (!(rates(row, column) >= 0.0) || !std::isfinite(rates(row, column))) {
        return InvalidArgument("rate from {} to {}: {}", row, column, rates(row, column));
      }
    }
    const double leave = rates.row(row).sum();
    if (!(std::abs(leave + rate_matrix(row, row)) <= 1e-9 * leave)) {
      return InvalidArgument("rates from {} do not sum to 0", row);
    }
  }
  const Eigen::Index modes = rates.rows() - 1;
  if (modes == 0) return Uniform(0, 0.0);
  const double first = rates(0, 1);
  const Eigen::MatrixXd others = first * Eigen::MatrixXd::Identity(modes + 1, modes + 1) + rates;
  if ((others.array() == first).all()) {
    return Uniform(static_cast<int>(modes), first * static_cast<double>(modes));
  }
  rates.diagonal() = -rates.rowwise().sum();
  const double mean_leave_rate = -rates.diagonal().mean();
  ModeChain chain(std::move(rates), mean_leave_rate);
  chain.uniform_ = false;
  chain.stationary_ = chain.Propagate(chain.stationary_, kForever);
  return chain;
}

// Q has the eigenvalues 0 (the uniform distribution) and -λ (n+1)/n (everything else), so that
// exp(QΔt) = U + (I - U) exp(-λ (n+1)/n Δt), U = 1 1ᵀ / (n+1).
// 1 - exp(..) would leave nothing of a short time.
double ModeChain::Forgotten(Duration elapsed) const {
  const int modes = states() - 1;
  if (modes == 0) return 0.0;
  const double seconds = std::max(0.0, ToSeconds(elapsed));
  return -std::expm1(-leave_rate_per_s_ * states() / modes * seconds);
}

Eigen::MatrixXd ModeChain::Transition(Duration elapsed) const {
  if (!uniform_) return StochasticExponential(rate_matrix_, std::max(0.0, ToSeconds(elapsed)));
  const double forgotten = Forgotten(elapsed);
  Eigen::MatrixXd transition = Eigen::MatrixXd::Constant(states(), states(), forgotten / states());
  transition.diagonal().array() += 1.0 - forgotten;
  return transition;
}

void ModeChain::Spread(double forgotten, Eigen::VectorXd* probabilities) {
  const double each = forgotten / static_cast<double>(probabilities->size()) * probabilities->sum();
  *probabilities = ((1.0 - forgotten) * *probabilities).array() + each;
}

Eigen::VectorXd ModeChain::Propagate(const Eigen::VectorXd& probabilities, Duration elapsed) const {
  SHIFTMAP_CHECK(probabilities.size() == states(),
                 "{} probabilities for {} states",
                 probabilities.size(),
                 states());
  if (!uniform_) return Transition(elapsed).transpose() * probabilities;
  Eigen::VectorXd result = probabilities;
  Spread(Forgotten(elapsed), &result);
  return result;
}

}  // namespace shiftmap
