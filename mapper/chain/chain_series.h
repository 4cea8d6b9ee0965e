// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

namespace shiftmap {

/// A chain as a power series, for gaps in which it hardly jumps (uniformization). With Λ the
/// fastest rate of leaving, P = I + Q / Λ, and w_k the probability of k events of rate Λ in a gap
/// Δ,
///
///   Π(Δ) = Σ_k w_k P^k,   G = Σ_{i,j} w_{i+j+1} / Λ (Pᵀ)^i C (Pᵀ)^j.
///
/// No term is negative, and no digits are lost. The powers are common to all gaps, and weights C
/// enter by w_k C alone, so that a gap costs the number of its terms times the squared states.
/// @tparam kStates  Or Eigen::Dynamic.
template <int kStates>
class ChainSeries {
 public:
  using Matrix = Eigen::Matrix<double, kStates, kStates>;

  /// @param rates  Q, rows sum to 0. [1/s]
  explicit ChainSeries(const Eigen::MatrixXd& rates)
      : states_(rates.rows()), fastest_(std::max(0.0, -rates.diagonal().minCoeff())) {
    powers_.reserve(8);
    powers_.assign(2, Matrix::Identity(states_, states_));
    if (fastest_ > 0.0) powers_.back() += rates.transpose() / fastest_;
  }

  /// Whether a gap has few terms.
  bool Suits(double length_s) const { return fastest_ * length_s <= 1.0; }

  /// Π(Δ)ᵀ.
  Matrix Flow(double length_s) {
    const double events = fastest_ * length_s;
    const double none = std::exp(-events);
    double weight = none * events;
    Matrix flow = weight * powers_[1];
    flow.diagonal().array() += none;
    for (std::size_t k = 2; Matters(weight, k); ++k) {
      weight *= events / static_cast<double>(k);
      flow += weight * Power(k);
    }
    return flow;
  }

  /// Adds the integral of one gap, GapIntegral(), to Sum(). @param weights  C >= 0.
  void AddIntegral(double length_s, const Matrix& weights) {
    const double events = fastest_ * length_s;
    double weight = std::exp(-events);
    for (std::size_t k = 0; Matters(weight, k); ++k) {
      if (k == parts_.size()) parts_.push_back(Matrix::Zero(states_, states_));
      parts_[k] += (length_s * weight) * weights;
      weight *= events / static_cast<double>(k + 2);
    }
  }

  /// The integrals so far: with D_k the sums of w_{k+1} C / Λ, Horner's rule for F_i = Σ_j D_{i+j}
  /// (Pᵀ)^j, and again for Σ_i (Pᵀ)^i F_i.
  Matrix Sum() {
    Matrix right = Matrix::Zero(states_, states_);
    Matrix sum = right;
    for (std::size_t i = parts_.size(); i-- > 0;) {
      right = (parts_[i] + right * powers_[1]).eval();
      sum = (right + powers_[1] * sum).eval();
    }
    return sum;
  }

 private:
  // Of term k, next to one of the weight. One term for each state matters at least, so that what
  // needs many jumps is not impossible.
  bool Matters(double weight, std::size_t k) const {
    constexpr double kNegligible = 1e-17;
    return weight > kNegligible || k < static_cast<std::size_t>(states_);
  }

  const Matrix& Power(std::size_t k) {
    while (powers_.size() <= k) powers_.push_back(powers_.back() * powers_[1]);
    return powers_[k];
  }

  Eigen::Index states_;
  double fastest_;              // Λ. [1/s]
  std::vector<Matrix> powers_;  // (Pᵀ)^k.
  std::vector<Matrix> parts_;   // D_k. [s]
};

}  // namespace shiftmap
