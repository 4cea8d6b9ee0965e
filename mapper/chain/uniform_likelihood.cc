// SPDX-License-Identifier: Apache-2.0
#include "mapper/chain/uniform_likelihood.h"

#include <cmath>
#include <cstddef>
#include <vector>

#include "mapper/chain/fixed_states.h"
#include "mapper/chain/log_product.h"
#include "proto/core/check.h"

namespace shiftmap {
namespace {

// Share that a gap spreads evenly, and its derivatives by u.
struct Spread {
  double value = 0.0;
  double slope = 0.0;
  double curvature = 0.0;
};

std::vector<Spread> SpreadOf(const ChainSteps& steps, double log_rate) {
  const double count = steps.states;
  const double mixing = std::exp(log_rate) * count / (count - 1.0);  // [1/s]
  std::vector<Spread> spreads;
  spreads.reserve(steps.gaps.size());
  for (const ChainSteps::Gap& gap : steps.gaps) {
    const double events = mixing * ToSeconds(gap.length);
    const double slope = events * std::exp(-events);
    spreads.push_back({-std::expm1(-events), slope, slope * (1.0 - events)});
  }
  return spreads;
}

template <int kStates>
UniformLikelihood Evaluate(const ChainSteps& steps, double log_rate) {
  using Vector = Eigen::Array<double, kStates, 1>;
  const std::vector<Spread> spreads = SpreadOf(steps, log_rate);
  const double even = 1.0 / steps.states;
  Vector p = Vector::Constant(steps.states, even);  // Filtered,
  Vector p1 = Vector::Zero(steps.states);           // its derivative,
  Vector p2 = p1;                                   // and the second one.
  UniformLikelihood result;
  LogProduct product;
  for (Eigen::Index t = 0; t < steps.likelihoods.cols(); ++t) {
    const int gap = steps.gap_of_step[static_cast<std::size_t>(t)];
    if (gap >= 0) {
      const Spread& spread = spreads[static_cast<std::size_t>(gap)];
      const double kept = 1.0 - spread.value;
      p2 = kept * p2 - 2.0 * spread.slope * p1 - spread.curvature * (p - even);
      p1 = kept * p1 - spread.slope * (p - even);
      p = kept * p + spread.value * even;
    }
    const auto likelihoods = steps.likelihoods.col(t).array();
    p *= likelihoods;
    p1 *= likelihoods;
    p2 *= likelihoods;
    const double evidence = p.sum();
    SHIFTMAP_CHECK(evidence > 0.0, "what was seen is impossible");
    const double inverse = 1.0 / evidence;
    const double slope = p1.sum() * inverse;
    const double curvature = p2.sum() * inverse;
    p *= inverse;
    p1 = p1 * inverse - p * slope;
    p2 = p2 * inverse - 2.0 * p1 * slope - p * curvature;
    result.slope += slope;
    result.curvature += curvature - slope * slope;
    product.Multiply(evidence);
  }
  result.value = steps.log_scale + product.Log();
  return result;
}

}  // namespace

UniformLikelihood EvaluateUniform(const ChainSteps& steps, double log_rate) {
  SHIFTMAP_CHECK(
      steps.states >= 2 && steps.phases == 1, "{} states, {} phases", steps.states, steps.phases);
  return WithFixedStates(steps.states,
                         [&](auto states) { return Evaluate<states()>(steps, log_rate); });
}

}  // namespace shiftmap
