// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <complex>
#include <optional>
#include <variant>

namespace shiftmap {

/// A chain in the eigenvectors of its rate matrix, Q = V Λ V⁻¹: many gaps cost a few products of
/// small matrices each, where exponentials cost twenty times as much.
///
/// In these, with M = Vᵀ C V⁻ᵀ, the integral of a gap Δ is G = V⁻ᵀ (M ∘ Φ(Δ)) Vᵀ,
///
///   Φ_ij = (exp(λ_i Δ) - exp(λ_j Δ)) / (λ_i - λ_j),   Δ exp(λ_i Δ) for equal ones;
///
/// the sum over all gaps goes back once.
class ChainSpectrum {
 public:
  static constexpr int kMaxStates = 10;

  /// Nothing if the chain has more states, or its eigenvectors are so near to each other that
  /// digits are lost.
  /// @param rates  Q, rows sum to 0. [1/s]
  static std::optional<ChainSpectrum> Of(const Eigen::MatrixXd& rates);

  /// Π(Δ). @param length_s  > 0.
  Eigen::MatrixXd Transition(double length_s) const;

  /// Adds the integral of one gap, GapIntegral(), to Sum(). @param weights  C >= 0.
  void AddIntegral(double length_s, const Eigen::MatrixXd& weights);

  /// The integrals so far.
  Eigen::MatrixXd Sum() const;

 private:
  // In real numbers, or in complex ones if a pair of eigenvalues is.
  template <typename Scalar>
  struct Basis {
    using Matrix = Eigen::
        Matrix<Scalar, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, kMaxStates, kMaxStates>;
    using Vector = Eigen::Matrix<Scalar, Eigen::Dynamic, 1, Eigen::ColMajor, kMaxStates, 1>;

    Vector rates;    // Λ. [1/s]
    Matrix vectors;  // V,
    Matrix inverse;  // and its inverse.
    Matrix sum;      // Of M ∘ Φ.

    Eigen::MatrixXd Transition(double length_s) const;
    void AddIntegral(double length_s, const Eigen::MatrixXd& weights);
    Eigen::MatrixXd Sum() const;
  };

  template <typename Scalar>
  static std::optional<ChainSpectrum> Make(typename Basis<Scalar>::Vector rates,
                                           typename Basis<Scalar>::Matrix vectors);

  std::variant<Basis<double>, Basis<std::complex<double>>> basis_;
};

}  // namespace shiftmap
