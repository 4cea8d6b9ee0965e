// SPDX-License-Identifier: Apache-2.0
#include "mapper/chain/gap_integral.h"
#include "mapper/chain/fixed_states.h"

#include <cmath>
#include <unsupported/Eigen/MatrixFunctions>

namespace shiftmap {
namespace {

// Of a uniform chain Q = Qᵀ has the eigenvalues 0, of U = 1 1ᵀ / n, and -μ, of R = I - U. With
// C = (U + R) C (U + R),
//
//   G = Δ U C U + Δ e^(-μΔ) R C R + (1 - e^(-μΔ)) / μ (U C R + R C U).
Eigen::MatrixXd UniformIntegral(const Eigen::MatrixXd& rates,
                                double length,
                                const Eigen::MatrixXd& C) {
  const Eigen::Index n = rates.rows();
  const auto count = static_cast<double>(n);
  if (n == 1) return length * C;
  const double decay = -rates(0, 0) * count / (count - 1.0) * length;  // μΔ
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
Eigen::MatrixXd BlockIntegral(const Eigen::MatrixXd& rates,
                              double length,
                              const Eigen::MatrixXd& C) {
  constexpr int kBlock = kStates == Eigen::Dynamic ? Eigen::Dynamic : 2 * kStates;
  using Matrix = Eigen::Matrix<double, kStates, kStates>;
  const Eigen::Index n = rates.rows();
  int doublings = 0;
  for (const double fastest = -rates.diagonal().minCoeff(); length * fastest > 1.0; length *= 0.5) {
    ++doublings;
  }
  // The off-diagonal block enters as a factor only. It is scaled to one, because the exponential
  // has the precision of its largest part.
  const double weight = C.maxCoeff();
  Eigen::Matrix<double, kBlock, kBlock> block =
      Eigen::Matrix<double, kBlock, kBlock>::Zero(2 * n, 2 * n);
  block.topLeftCorner(n, n) = length * rates.transpose();
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

bool IsUniform(const Eigen::MatrixXd& rates) {
  if (rates.rows() < 2) return true;
  Eigen::MatrixXd others = rates;
  others.diagonal().setConstant(rates(0, 1));
  return (others.array() == rates(0, 1)).all();
}

Eigen::MatrixXd GapIntegral(const Eigen::MatrixXd& rates,
                            double length_s,
                            const Eigen::MatrixXd& weights) {
  const Eigen::Index n = rates.rows();
  if (!(weights.maxCoeff() > 0.0) || !(length_s > 0.0)) return Eigen::MatrixXd::Zero(n, n);
  if (IsUniform(rates)) return UniformIntegral(rates, length_s, weights);
  return WithFixedStates(
      n, [&](auto states) { return BlockIntegral<states()>(rates, length_s, weights); });
}

}  // namespace shiftmap
