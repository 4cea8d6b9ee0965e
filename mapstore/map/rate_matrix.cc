// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/rate_matrix.h"

#include <cmath>
#include <unsupported/Eigen/MatrixFunctions>

namespace shiftmap {
namespace {

// The eigenvalues are 0 and minus the sum of both rates.
Eigen::MatrixXd TwoStates(double from_0, double from_1, double seconds) {
  Eigen::MatrixXd transition = Eigen::MatrixXd::Identity(2, 2);
  const double sum = from_0 + from_1;
  if (sum == 0.0) return transition;
  const double forgotten = -std::expm1(-sum * seconds);
  transition(0, 1) = forgotten * from_0 / sum;
  transition(1, 0) = forgotten * from_1 / sum;
  transition(0, 0) = 1.0 - transition(0, 1);
  transition(1, 1) = 1.0 - transition(1, 0);
  return transition;
}

}  // namespace

StatusOr<Eigen::MatrixXd> CheckedRates(Eigen::MatrixXd rates) {
  if (rates.rows() < 1 || rates.rows() != rates.cols()) {
    return InvalidArgument("rate matrix of {} x {}, expected square", rates.rows(), rates.cols());
  }
  for (Eigen::Index row = 0; row < rates.rows(); ++row) {
    double leave = 0.0;
    for (Eigen::Index column = 0; column < rates.cols(); ++column) {
      if (row == column) continue;
      if (!(rates(row, column) >= 0.0) || !std::isfinite(rates(row, column))) {
        return InvalidArgument("rate from {} to {}: {}", row, column, rates(row, column));
      }
      leave += rates(row, column);
    }
    if (!(std::abs(leave + rates(row, row)) <= 1e-9 * leave)) {
      return InvalidArgument("rates from {} do not sum to 0", row);
    }
  }
  rates.diagonal().setZero();
  rates.diagonal() = -rates.rowwise().sum();
  return rates;
}

void NormalizeRows(Eigen::MatrixXd* matrix) {
  *matrix = matrix->cwiseMax(0.0).eval();
  for (Eigen::Index row = 0; row < matrix->rows(); ++row) {
    matrix->row(row) /= matrix->row(row).sum();
  }
}

Eigen::MatrixXd StochasticExponential(const Eigen::MatrixXd& rates, double seconds) {
  if (rates.rows() == 2) return TwoStates(rates(0, 1), rates(1, 0), seconds);
  // Squaring here and not in the library: rounding would grow over the hundred squarings of years
  // at a rate of seconds.
  int squarings = 0;
  double step = seconds;
  const double fastest = -rates.diagonal().minCoeff();
  while (step * fastest > 1.0) {
    step *= 0.5;
    ++squarings;
  }
  Eigen::MatrixXd transition = (rates * step).exp();
  NormalizeRows(&transition);
  for (; squarings > 0; --squarings) {
    transition = (transition * transition).eval();
    NormalizeRows(&transition);
  }
  return transition;
}

}  // namespace shiftmap
