// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include "proto/core/status.h"

namespace shiftmap {

/// The rates of a mode chain, rows = from, with a diagonal that makes rows sum to 0 exactly.
/// @param rates  Square, off-diagonal entries finite and >= 0. Rows sum to 0 within 1e-9 of the
/// rate
///               of leaving. [1/s]
/// Errors: kInvalidArgument, naming the entry or row.
StatusOr<Eigen::MatrixXd> CheckedRates(Eigen::MatrixXd rates);

/// Makes the rows of a matrix distributions to the last bit: nothing below 0, sum 1.
void NormalizeRows(Eigen::MatrixXd* matrix);

/// exp(Q t) in closed form for two states, else by scaling and squaring, with rows that are
/// distributions to the last bit.
/// @param rates  Q, rows = from; rows sum to 0, off-diagonal entries are >= 0. [1/s]
Eigen::MatrixXd StochasticExponential(const Eigen::MatrixXd& rates, double seconds);

}  // namespace shiftmap
