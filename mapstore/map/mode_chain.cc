// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/mode_chain.h"

#include <algorithm>
#include <chrono>
#include <utility>

#include "mapstore/map/rate_matrix.h"
#include "proto/core/check.h"

namespace shiftmap {
namespace {

// Long against the time between any two changes, short enough not to overflow.
constexpr Duration kForever = std::chrono::hours(24 * 365 * 200);

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
  SHIFTMAP_ASSIGN_OR_RETURN(Eigen::MatrixXd rates, CheckedRates(rate_matrix));
  const Eigen::Index modes = rates.rows() - 1;
  if (modes == 0) return Uniform(0, 0.0);
  const double first = rates(0, 1);
  Eigen::MatrixXd others = rates;
  others.diagonal().setConstant(first);
  if ((others.array() == first).all()) {
    return Uniform(static_cast<int>(modes), first * static_cast<double>(modes));
  }
  const double mean_leave_rate = -rates.diagonal().mean();
  ModeChain chain(std::move(rates), mean_leave_rate);
  chain.uniform_ = false;
  chain.stationary_ = chain.Propagate(chain.stationary_, kForever);
  return chain;
}

StatusOr<ModeChain> ModeChain::WithRhythm(ChainRhythm rhythm) const {
  if (rhythm.states() != states()) {
    return InvalidArgument("rhythm of {} states, expected {}", rhythm.states(), states());
  }
  ModeChain chain = *this;
  chain.rhythm_ = std::make_shared<const ChainRhythm>(std::move(rhythm));
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

Eigen::MatrixXd ModeChain::Transition(Stamp from, Stamp to) const {
  return rhythm_ ? rhythm_->Transition(from, to) : Transition(Elapsed(from, to));
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

Eigen::VectorXd ModeChain::Propagate(const Eigen::VectorXd& probabilities,
                                     Stamp from,
                                     Stamp to) const {
  if (!rhythm_ || to <= from) return Propagate(probabilities, Elapsed(from, to));
  SHIFTMAP_CHECK(probabilities.size() == states(),
                 "{} probabilities for {} states",
                 probabilities.size(),
                 states());
  return rhythm_->Transition(from, to).transpose() * probabilities;
}

}  // namespace shiftmap
