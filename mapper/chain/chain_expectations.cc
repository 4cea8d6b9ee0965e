// SPDX-License-Identifier: Apache-2.0
#include "mapper/chain/chain_expectations.h"

#include <cmath>
#include <limits>
#include <optional>
#include <unsupported/Eigen/MatrixFunctions>

#include "mapper/chain/chain_spectrum.h"
#include "proto/core/check.h"

namespace shiftmap {
namespace {

// A chain as its gaps are computed.
struct PreparedChain {
  explicit PreparedChain(const ModeChain& of) : chain(&of) {
    if (!of.uniform()) spectrum = ChainSpectrum::Of(of);
  }

  Eigen::MatrixXd Transition(Duration gap) const {
    if (!spectrum || !(gap > Duration(0))) return chain->Transition(gap);
    return spectrum->Transition(ToSeconds(gap));
  }

  const ModeChain* chain;
  std::optional<ChainSpectrum> spectrum;  // Of one that is not uniform, if it is good for it.
};

std::vector<PreparedChain> Prepare(const std::vector<ModeChain>& chains) {
  return {chains.begin(), chains.end()};
}

// The filter's pass over the steps.
struct ForwardPass {
  std::vector<Eigen::MatrixXd> transitions;  // Per different gap.
  Eigen::MatrixXd filtered;                  // states x steps, columns sum to 1.
  Eigen::VectorXd evidence;                  // Per step, what the column was divided by.
  double log_likelihood = 0.0;
};

ForwardPass RunForward(const ChainSteps& steps, const std::vector<PreparedChain>& chains) {
  SHIFTMAP_CHECK(static_cast<int>(chains.size()) == steps.phases,
                 "{} chains for {} phases",
                 chains.size(),
                 steps.phases);
  ForwardPass pass;
  for (const ChainSteps::Gap& gap : steps.gaps) {
    const PreparedChain& prepared = chains[static_cast<std::size_t>(gap.phase)];
    SHIFTMAP_CHECK(prepared.chain->states() == steps.states,
                   "chain of {} states, history of {}",
                   prepared.chain->states(),
                   steps.states);
    pass.transitions.push_back(prepared.Transition(gap.length));
  }
  const Eigen::Index count = steps.likelihoods.cols();
  pass.filtered.resize(steps.states, count);
  pass.evidence.resize(count);
  pass.log_likelihood = steps.log_scale;
  for (Eigen::Index t = 0; t < count; ++t) {
    auto now = pass.filtered.col(t);
    const int gap = steps.gap_of_step[static_cast<std::size_t>(t)];
    if (gap < 0) {
      now.setConstant(1.0 / steps.states);
    } else {
      now.noalias() =
          pass.transitions[static_cast<std::size_t>(gap)].transpose() * pass.filtered.col(t - 1);
    }
    now.array() *= steps.likelihoods.col(t).array();
    const double evidence = now.sum();
    pass.evidence(t) = evidence;
    pass.log_likelihood += std::log(evidence);
    if (!(evidence > 0.0)) {
      pass.log_likelihood = -std::numeric_limits<double>::infinity();
      return pass;
    }
    now /= evidence;
  }
  return pass;
}

// Of a uniform chain Q = Qᵀ has the eigenvalues 0, of U = 1 1ᵀ / n, and -μ, of R = I - U. With
// C = (U + R) C (U + R),
//
//   G = Δ U C U + Δ e^(-μΔ) R C R + (1 - e^(-μΔ)) / μ (U C R + R C U).
Eigen::MatrixXd UniformIntegral(const ModeChain& chain, double length, const Eigen::MatrixXd& C) {
  const Eigen::Index n = chain.states();
  const auto count = static_cast<double>(n);
  if (n == 1) return length * C;
  const double decay = chain.leave_rate_per_s() * count / (count - 1.0) * length;  // μΔ
  const double stays = length * std::exp(-decay);
  const double mixes = decay > 0.0 ? length * -std::expm1(-decay) / decay : length;
  const Eigen::MatrixXd UC = C.colwise().mean().replicate(n, 1);
  const Eigen::MatrixXd CU = C.rowwise().mean().replicate(1, n);
  const double UCU = C.mean();
  const Eigen::ArrayXXd once = (UC + CU).array();  // U C R + R C U + 2 U C U
  return (length * UCU + stays * (C.array() - once + UCU) + mixes * (once - 2.0 * UCU))
      .cwiseMax(0.0);
}

// The integral as a block of an exponential, for a chain of `kStates` states.
template <int kStates>
Eigen::MatrixXd BlockIntegral(const ModeChain& chain, double length, const Eigen::MatrixXd& C) {
  constexpr int kBlock = kStates == Eigen::Dynamic ? Eigen::Dynamic : 2 * kStates;
  using Matrix = Eigen::Matrix<double, kStates, kStates>;
  const Eigen::Index n = chain.states();
  int doublings = 0;
  for (const double fastest = -chain.rate_matrix().diagonal().minCoeff(); length * fastest > 1.0;
       length *= 0.5) {
    ++doublings;
  }
  // The block beside Qᵀ is scaled to the size of one, since it only enters as a factor and the
  // exponential's precision is that of its largest part.
  const double weight = C.maxCoeff();
  Eigen::Matrix<double, kBlock, kBlock> block =
      Eigen::Matrix<double, kBlock, kBlock>::Zero(2 * n, 2 * n);
  block.topLeftCorner(n, n) = length * chain.rate_matrix().transpose();
  block.bottomRightCorner(n, n) = block.topLeftCorner(n, n);
  block.topRightCorner(n, n) = C / weight;
  const Eigen::Matrix<double, kBlock, kBlock> exponential = block.exp();
  Matrix integral = exponential.topRightCorner(n, n).cwiseMax(0.0) * (weight * length);
  // G(2h) = exp(Qᵀh) G(h) + G(h) exp(Qᵀh), with rows of the transition that stay distributions
  // over any number of doublings.
  Matrix transition = exponential.topLeftCorner(n, n).transpose().cwiseMax(0.0);
  for (; doublings > 0; --doublings) {
    for (Eigen::Index row = 0; row < n; ++row) transition.row(row) /= transition.row(row).sum();
    integral = (transition.transpose() * integral + integral * transition.transpose()).eval();
    transition = (transition * transition).eval();
  }
  return integral;
}

}  // namespace

Eigen::MatrixXd GapIntegral(const ModeChain& chain, Duration gap, const Eigen::MatrixXd& weights) {
  const Eigen::Index n = chain.states();
  const double length = ToSeconds(gap);
  if (!(weights.maxCoeff() > 0.0) || !(length > 0.0)) return Eigen::MatrixXd::Zero(n, n);
  if (chain.uniform()) return UniformIntegral(chain, length, weights);
  switch (n) {
    case 2:
      return BlockIntegral<2>(chain, length, weights);
    case 3:
      return BlockIntegral<3>(chain, length, weights);
    case 4:
      return BlockIntegral<4>(chain, length, weights);
    default:
      return BlockIntegral<Eigen::Dynamic>(chain, length, weights);
  }
}

ChainExpectations ExpectChain(const ChainSteps& steps, const std::vector<ModeChain>& chains) {
  std::vector<PreparedChain> prepared = Prepare(chains);
  const ForwardPass pass = RunForward(steps, prepared);
  SHIFTMAP_CHECK(std::isfinite(pass.log_likelihood), "what was seen is impossible");
  const Eigen::MatrixXd zero = Eigen::MatrixXd::Zero(steps.states, steps.states);

  // Gaps of one length share an integral: the weights add up.
  std::vector<Eigen::MatrixXd> weights(steps.gaps.size(), zero);
  Eigen::VectorXd backward = Eigen::VectorXd::Ones(steps.states);
  Eigen::VectorXd after(steps.states);
  for (Eigen::Index t = steps.likelihoods.cols() - 1; t > 0; --t) {
    const auto gap = static_cast<std::size_t>(steps.gap_of_step[static_cast<std::size_t>(t)]);
    after = steps.likelihoods.col(t).cwiseProduct(backward) / pass.evidence(t);
    weights[gap].noalias() += pass.filtered.col(t - 1) * after.transpose();
    backward.noalias() = pass.transitions[gap] * after;
  }

  ChainExpectations result{pass.log_likelihood, std::vector<Eigen::MatrixXd>(chains.size(), zero)};
  for (std::size_t i = 0; i < steps.gaps.size(); ++i) {
    const auto phase = static_cast<std::size_t>(steps.gaps[i].phase);
    const Duration length = steps.gaps[i].length;
    if (std::optional<ChainSpectrum>& spectrum = prepared[phase].spectrum) {
      spectrum->AddIntegral(ToSeconds(length), weights[i]);
    } else {
      result.integrals[phase] += GapIntegral(chains[phase], length, weights[i]);
    }
  }
  for (std::size_t phase = 0; phase < chains.size(); ++phase) {
    if (prepared[phase].spectrum) result.integrals[phase] = prepared[phase].spectrum->Sum();
  }
  return result;
}

double ChainLogLikelihood(const ChainSteps& steps, const std::vector<ModeChain>& chains) {
  return RunForward(steps, Prepare(chains)).log_likelihood;
}

double PredictiveLogLikelihood(const ChainHistory& history,
                               std::size_t first,
                               const std::vector<ModeChain>& chains,
                               Duration period,
                               double gap_resolution) {
  const RhythmCalendar calendar{period, static_cast<int>(chains.size())};
  const auto log_likelihood = [&](const ChainHistory& of) {
    return ChainLogLikelihood(MakeChainSteps(of, calendar, gap_resolution), chains);
  };
  return log_likelihood(history) - log_likelihood(FirstVisits(history, first));
}

}  // namespace shiftmap
