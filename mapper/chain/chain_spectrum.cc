// SPDX-License-Identifier: Apache-2.0
#include "mapper/chain/chain_spectrum.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <cmath>
#include <utility>

namespace shiftmap {
namespace {

// (eᵃ - eᵇ) / (a - b), by a series where that would lose digits.
template <typename Scalar>
Scalar DividedDifference(Scalar a, Scalar b, Scalar exp_a, Scalar exp_b) {
  constexpr double kNear = 1e-4;
  const Scalar d = a - b;
  if (std::abs(d) < kNear) return exp_b * (1.0 + d / 2.0 + d * d / 6.0);
  return (exp_a - exp_b) / d;
}

}  // namespace

template <typename Scalar>
Eigen::MatrixXd ChainSpectrum::Basis<Scalar>::Transition(double length_s) const {
  const Vector decay = (rates * length_s).array().exp();
  const Matrix product = vectors * decay.asDiagonal() * inverse;
  Eigen::MatrixXd transition = product.real().cwiseMax(0.0);
  transition.array().colwise() /= transition.rowwise().sum().array();
  return transition;
}

template <typename Scalar>
void ChainSpectrum::Basis<Scalar>::AddIntegral(double length_s, const Eigen::MatrixXd& weights) {
  const Vector powers = rates * length_s;
  const Vector exponentials = powers.array().exp();
  const Matrix known = weights.template cast<Scalar>();
  const Matrix half = vectors.transpose() * known;
  const Matrix in_vectors = half * inverse.transpose();
  for (Eigen::Index j = 0; j < powers.size(); ++j) {
    for (Eigen::Index i = 0; i < powers.size(); ++i) {
      sum(i, j) += in_vectors(i, j) * length_s *
                   DividedDifference(powers(i), powers(j), exponentials(i), exponentials(j));
    }
  }
}

template <typename Scalar>
Eigen::MatrixXd ChainSpectrum::Basis<Scalar>::Sum() const {
  const Matrix half = inverse.transpose() * sum;
  const Matrix back = half * vectors.transpose();
  return back.real().cwiseMax(0.0);
}

template <typename Scalar>
std::optional<ChainSpectrum> ChainSpectrum::Make(typename Basis<Scalar>::Vector rates,
                                                 typename Basis<Scalar>::Matrix vectors) {
  constexpr double kMaxCondition = 1e4;
  Basis<Scalar> basis;
  basis.inverse = vectors.inverse();
  if (!(vectors.norm() * basis.inverse.norm() < kMaxCondition)) return std::nullopt;
  basis.rates = std::move(rates);
  basis.sum.setZero(vectors.rows(), vectors.cols());
  basis.vectors = std::move(vectors);
  ChainSpectrum spectrum;
  spectrum.basis_ = std::move(basis);
  return spectrum;
}

std::optional<ChainSpectrum> ChainSpectrum::Of(const Eigen::MatrixXd& rate_matrix) {
  if (rate_matrix.rows() > kMaxStates) return std::nullopt;
  const Eigen::EigenSolver<Eigen::MatrixXd> solver(rate_matrix);
  if (solver.info() != Eigen::Success) return std::nullopt;
  if (solver.eigenvalues().imag().isZero(0.0)) {
    return Make<double>(solver.eigenvalues().real(), solver.pseudoEigenvectors());
  }
  return Make<std::complex<double>>(solver.eigenvalues(), solver.eigenvectors());
}

Eigen::MatrixXd ChainSpectrum::Transition(double length_s) const {
  return std::visit([&](const auto& basis) { return basis.Transition(length_s); }, basis_);
}

void ChainSpectrum::AddIntegral(double length_s, const Eigen::MatrixXd& weights) {
  std::visit([&](auto& basis) { basis.AddIntegral(length_s, weights); }, basis_);
}

Eigen::MatrixXd ChainSpectrum::Sum() const {
  return std::visit([](const auto& basis) { return basis.Sum(); }, basis_);
}

}  // namespace shiftmap
