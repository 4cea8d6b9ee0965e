// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/mode_chain.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "proto/core/check.h"

namespace shiftmap {

ModeChain::ModeChain(Eigen::MatrixXd rate_matrix, double leave_rate_per_s)
    : rate_matrix_(std::move(rate_matrix)), leave_rate_per_s_(leave_rate_per_s) {}

ModeChain ModeChain::Uniform(int modes, double leave_rate_per_s) {
  SHIFTMAP_CHECK(
      modes >= 0 && leave_rate_per_s >= 0.0, "modes {}, leave rate {}", modes, leave_rate_per_s);
  const int states = modes + 1;
  if (modes == 0) return ModeChain(Eigen::MatrixXd::Zero(1, 1), leave_rate_per_s);
  Eigen::MatrixXd rates = Eigen::MatrixXd::Constant(states, states, leave_rate_per_s / modes);
  rates.diagonal().setConstant(-leave_rate_per_s);
  return ModeChain(std::move(rates), leave_rate_per_s);
}

// Q has the eigenvalues 0 (the uniform distribution) and -λ (n+1)/n (everything else), so that
// exp(QΔt) = U + (I - U) exp(-λ (n+1)/n Δt), U = 1 1ᵀ / (n+1).
double ModeChain::Remaining(Duration elapsed) const {
  const int modes = states() - 1;
  if (modes == 0) return 1.0;
  const double seconds = std::max(0.0, ToSeconds(elapsed));
  return std::exp(-leave_rate_per_s_ * states() / modes * seconds);
}

Eigen::MatrixXd ModeChain::Transition(Duration elapsed) const {
  const double remaining = Remaining(elapsed);
  Eigen::MatrixXd transition =
      Eigen::MatrixXd::Constant(states(), states(), (1.0 - remaining) / states());
  transition.diagonal().array() += remaining;
  return transition;
}

Eigen::VectorXd ModeChain::Propagate(const Eigen::VectorXd& probabilities, Duration elapsed) const {
  SHIFTMAP_CHECK(probabilities.size() == states(),
                 "{} probabilities for {} states",
                 probabilities.size(),
                 states());
  const double remaining = Remaining(elapsed);
  const double spread = (1.0 - remaining) / states() * probabilities.sum();
  return (remaining * probabilities).array() + spread;
}

}  // namespace shiftmap
