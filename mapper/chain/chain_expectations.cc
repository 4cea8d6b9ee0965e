// SPDX-License-Identifier: Apache-2.0
#include "mapper/chain/chain_expectations.h"

#include <cmath>
#include <limits>
#include <optional>

#include "mapper/chain/chain_series.h"
#include "mapper/chain/chain_spectrum.h"
#include "mapper/chain/fixed_states.h"
#include "mapper/chain/gap_integral.h"
#include "mapper/chain/log_product.h"
#include "mapstore/map/rate_matrix.h"
#include "proto/core/check.h"

namespace shiftmap {
namespace {

// The gaps of one phase.
template <int kStates>
class PhaseChain {
 public:
  using Matrix = Eigen::Matrix<double, kStates, kStates>;

  // @param rates  Outlives this.
  explicit PhaseChain(const Eigen::MatrixXd& rates) : rates_(rates), series_(rates) {}

  // Π(Δ)ᵀ.
  Matrix Flow(double length_s) {
    if (series_.Suits(length_s)) return series_.Flow(length_s);
    if (HasSpectrum()) return spectrum_->Transition(length_s).transpose();
    return StochasticExponential(rates_, length_s).transpose();
  }

  void AddIntegral(double length_s, const Matrix& weights) {
    if (series_.Suits(length_s)) return series_.AddIntegral(length_s, weights);
    if (HasSpectrum()) return spectrum_->AddIntegral(length_s, weights);
    if (direct_.size() == 0) direct_.setZero(rates_.rows(), rates_.cols());
    direct_ += GapIntegral(rates_, length_s, weights);
  }

  Eigen::MatrixXd Sum() {
    Eigen::MatrixXd sum = series_.Sum();
    if (spectrum_) sum += spectrum_->Sum();
    if (direct_.size() > 0) sum += direct_;
    return sum;
  }

 private:
  bool HasSpectrum() {
    if (!asked_) spectrum_ = ChainSpectrum::Of(rates_);
    asked_ = true;
    return spectrum_.has_value();
  }

  const Eigen::MatrixXd& rates_;
  ChainSeries<kStates> series_;
  bool asked_ = false;  // Whether there is a spectrum.
  std::optional<ChainSpectrum> spectrum_;
  Eigen::MatrixXd direct_;  // Integrals of what neither suits.
};

// The forward and backward recursion. kStates is the number of states, or Eigen::Dynamic.
template <int kStates>
class Recursion {
 public:
  using Matrix = Eigen::Matrix<double, kStates, kStates>;
  using Vector = Eigen::Matrix<double, kStates, 1>;

  Recursion(const ChainSteps& steps, const std::vector<Eigen::MatrixXd>& rates) : steps_(steps) {
    SHIFTMAP_CHECK(static_cast<int>(rates.size()) == steps.phases,
                   "{} chains for {} phases",
                   rates.size(),
                   steps.phases);
    phases_.reserve(rates.size());
    for (const Eigen::MatrixXd& of_phase : rates) {
      SHIFTMAP_CHECK(of_phase.rows() == steps.states,
                     "chain of {} states, history of {}",
                     of_phase.rows(),
                     steps.states);
      phases_.emplace_back(of_phase);
    }
    flows_.reserve(steps.gaps.size());
    for (const ChainSteps::Gap& gap : steps.gaps) {
      flows_.push_back(gap.composed() ? Matrix(flows_[Index(gap.second)] * flows_[Index(gap.first)])
                                      : Phase(gap).Flow(ToSeconds(gap.length)));
    }
  }

  // The filter's pass. Returns the sum of the logarithms of the evidence from step `from` on.
  double Forward(Eigen::Index from) {
    const Eigen::Index count = steps_.likelihoods.cols();
    filtered_.resize(steps_.states, count);
    evidence_.resize(count);
    Vector now = Vector::Constant(steps_.states, 1.0 / steps_.states);
    LogProduct product;
    for (Eigen::Index t = 0; t < count; ++t) {
      const int gap = steps_.gap_of_step[static_cast<std::size_t>(t)];
      if (gap >= 0) now = (flows_[Index(gap)] * now).eval();
      now.array() *= steps_.likelihoods.col(t).array();
      const double evidence = now.sum();
      if (!(evidence > 0.0)) return -std::numeric_limits<double>::infinity();
      now /= evidence;
      filtered_.col(t) = now;
      evidence_(t) = evidence;
      if (t >= from) product.Multiply(evidence);
    }
    return product.Log();
  }

  // After Forward: the integrals of each phase.
  std::vector<Eigen::MatrixXd> Integrals() {
    const Matrix zero = Matrix::Zero(steps_.states, steps_.states);
    // Gaps of one length share an integral: the weights add up.
    std::vector<Matrix> weights(steps_.gaps.size(), zero);
    Vector backward = Vector::Ones(steps_.states);
    for (Eigen::Index t = steps_.likelihoods.cols() - 1; t > 0; --t) {
      const std::size_t gap = Index(steps_.gap_of_step[static_cast<std::size_t>(t)]);
      const Vector after = steps_.likelihoods.col(t).cwiseProduct(backward) / evidence_(t);
      weights[gap].noalias() += filtered_.col(t - 1) * after.transpose();
      backward.noalias() = flows_[gap].transpose() * after;
    }
    for (std::size_t i = steps_.gaps.size(); i-- > 0;) {
      const ChainSteps::Gap& gap = steps_.gaps[i];
      if (!gap.composed()) {
        Phase(gap).AddIntegral(ToSeconds(gap.length), weights[i]);
        continue;
      }
      weights[Index(gap.first)].noalias() += weights[i] * flows_[Index(gap.second)];
      weights[Index(gap.second)].noalias() += flows_[Index(gap.first)] * weights[i];
    }
    std::vector<Eigen::MatrixXd> integrals;
    for (PhaseChain<kStates>& phase : phases_) integrals.push_back(phase.Sum());
    return integrals;
  }

 private:
  static std::size_t Index(int gap) { return static_cast<std::size_t>(gap); }

  PhaseChain<kStates>& Phase(const ChainSteps::Gap& gap) { return phases_[Index(gap.phase)]; }

  const ChainSteps& steps_;
  std::vector<PhaseChain<kStates>> phases_;
  std::vector<Matrix> flows_;                                // Πᵀ per gap.
  Eigen::Matrix<double, kStates, Eigen::Dynamic> filtered_;  // Columns sum to 1.
  Eigen::VectorXd evidence_;  // Per step, what the column was divided by.
};

template <int kStates>
ChainExpectations Expect(const ChainSteps& steps, const std::vector<Eigen::MatrixXd>& rates) {
  Recursion<kStates> recursion(steps, rates);
  const double log_likelihood = recursion.Forward(0);
  SHIFTMAP_CHECK(std::isfinite(log_likelihood), "what was seen is impossible");
  return {steps.log_scale + log_likelihood, recursion.Integrals()};
}

double LogEvidence(const ChainSteps& steps,
                   Eigen::Index from,
                   const std::vector<Eigen::MatrixXd>& rates) {
  return WithFixedStates(
      steps.states, [&](auto states) { return Recursion<states()>(steps, rates).Forward(from); });
}

}  // namespace

ChainExpectations ExpectChain(const ChainSteps& steps, const std::vector<Eigen::MatrixXd>& rates) {
  return WithFixedStates(steps.states, [&](auto states) { return Expect<states()>(steps, rates); });
}

double PredictiveLogLikelihood(const ChainSteps& steps,
                               std::size_t first,
                               const std::vector<Eigen::MatrixXd>& rates) {
  SHIFTMAP_CHECK(
      first >= 1 && first <= steps.visits.size(), "{} of {} visits", first, steps.visits.size());
  double sum = LogEvidence(steps, steps.visits[first - 1].step + 1, rates);
  for (std::size_t i = first; i < steps.visits.size(); ++i) sum += steps.visits[i].log_scale;
  return sum;
}

double PredictiveLogLikelihood(const ChainHistory& history,
                               std::size_t first,
                               const std::vector<ModeChain>& chains,
                               Duration period) {
  const RhythmCalendar calendar{period, static_cast<int>(chains.size())};
  return PredictiveLogLikelihood(MakeChainSteps(history, calendar), first, RatesOf(chains));
}

std::vector<Eigen::MatrixXd> RatesOf(const std::vector<ModeChain>& chains) {
  std::vector<Eigen::MatrixXd> rates;
  for (const ModeChain& chain : chains) rates.push_back(chain.rate_matrix());
  return rates;
}

}  // namespace shiftmap
