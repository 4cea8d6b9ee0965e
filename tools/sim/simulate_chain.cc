// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/simulate_chain.h"

#include <algorithm>
#include <cmath>
#include <iterator>

#include "proto/core/check.h"

namespace shiftmap {
namespace {

constexpr double kLongest_s = 9e9;  // What a Duration can hold.

}  // namespace

int ChainPath::At(Stamp stamp) const {
  const auto next = std::upper_bound(since.begin(), since.end(), stamp);
  const auto index = std::max<std::ptrdiff_t>(0, std::distance(since.begin(), next) - 1);
  return states[static_cast<std::size_t>(index)];
}

ChainPath SimulateChain(
    const ModeChain& chain, int start, Stamp begin, Stamp end, std::mt19937_64& random) {
  ChainPath path{{begin}, {start}};
  for (Stamp now = begin;;) {
    const int state = path.states.back();
    const double leave = -chain.rate_matrix()(state, state);
    if (!(leave > 0.0)) break;
    const double stay = std::exponential_distribution<double>(leave)(random);
    if (stay > std::min(kLongest_s, ToSeconds(end - now))) break;
    now += FromSeconds(stay);
    const Eigen::VectorXd rates = chain.rate_matrix().row(state).transpose().cwiseMax(0.0);
    path.since.push_back(now);
    path.states.push_back(std::discrete_distribution<int>(rates.begin(), rates.end())(random));
  }
  return path;
}

ChainHistory ObservePath(const ChainPath& path,
                         int states,
                         const std::vector<Stamp>& stamps,
                         double wrong,
                         std::mt19937_64& random) {
  SHIFTMAP_CHECK(states > 1 && wrong > 0.0 && wrong < 1.0, "{} states, wrong {}", states, wrong);
  ChainHistory history{Signature("simulated"), states, {}};
  std::bernoulli_distribution errs(wrong);
  std::uniform_int_distribution<int> other(1, states - 1);
  for (const Stamp stamp : stamps) {
    int shown = path.At(stamp);
    if (errs(random)) shown = (shown + other(random)) % states;
    Eigen::VectorXd values = Eigen::VectorXd::Constant(states, std::log(wrong / (states - 1)));
    values(shown) = std::log(1.0 - wrong);
    history.visits.push_back({stamp, stamp, values});
  }
  return history;
}

}  // namespace shiftmap
