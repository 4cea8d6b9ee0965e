// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

namespace shiftmap {

/// Whether all rates between states are the same.
bool IsUniform(const Eigen::MatrixXd& rates);

/// The integral of one gap Δ for any C >= 0,
///
///     G = ∫_0^Δ exp(Qᵀ s) C exp(Qᵀ (Δ - s)) ds
///
/// It has a closed form for a uniform chain; else it is a block of an exponential of twice the size
/// (Van Loan, IEEE Transactions on Automatic Control 23(3), 1978), at any Δ. ChainSeries and
/// ChainSpectrum are faster where they are good. [s, if C has no unit]
/// @param rates  Q, rows sum to 0. [1/s]
Eigen::MatrixXd GapIntegral(const Eigen::MatrixXd& rates,
                            double length_s,
                            const Eigen::MatrixXd& weights);

}  // namespace shiftmap
