// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <random>
#include <utility>
#include <vector>

#include "mapper/graph/chain_elimination.h"

namespace shiftmap::testing {

// A system of chains of poses with a border and modes.
inline constexpr int kPoses = 24;  // Of each chain.
inline constexpr int kChains = 5;
inline constexpr int kModes = 25;
inline constexpr int kFirstCalibration = kChainRows * kPoses * kChains;
inline constexpr Border kBorder{kFirstCalibration, kChains, 2, true};
inline constexpr int kFirstMode = kFirstCalibration + 2 * kChains;
inline constexpr int kSize = kFirstMode + 2 * kModes;

struct ChainSystem {
  std::vector<SystemTerm> terms;

  // The sum of terms.
  Eigen::MatrixXd Dense() const {
    Eigen::MatrixXd H = Eigen::MatrixXd::Zero(kSize, kSize);
    for (const SystemTerm& term : terms) H(term.index, term.index) += term.H;
    return H;
  }
};

/// Terms between neighbouring poses of each chain, with the chain's calibration and `seen` modes.
/// All chains pass the first half of the modes, all but the last one pass the others.
inline ChainSystem MakeChainSystem(int seen, std::mt19937_64& random) {
  ChainSystem system;
  std::normal_distribution<double> normal;
  for (int chain = 0; chain < kChains; ++chain) {
    const int modes = chain + 1 < kChains ? kModes : kModes / 2;
    for (int i = 0; i + 1 < kPoses; ++i) {
      SystemTerm term;
      for (int row = 0; row < 2 * kChainRows; ++row) {
        term.index.push_back(kChainRows * (chain * kPoses + i) + row);
      }
      for (int row = 0; row < 2; ++row) term.index.push_back(kFirstCalibration + 2 * chain + row);
      for (int k = 0; k < seen; ++k) {
        const int mode = (i + k) % modes;
        term.index.push_back(kFirstMode + 2 * mode);
        term.index.push_back(kFirstMode + 2 * mode + 1);
      }
      const auto size = static_cast<Eigen::Index>(term.index.size());
      const Eigen::MatrixXd J =
          Eigen::MatrixXd::NullaryExpr(size, size, [&](auto, auto) { return normal(random); });
      term.H = J * J.transpose();
      system.terms.push_back(std::move(term));
    }
  }
  return system;
}

inline std::vector<int> RowsOutside() {
  std::vector<int> rows;
  for (int i = 0; i < kSize; ++i) {
    if (i < kBorder.begin || i >= kBorder.end()) rows.push_back(i);
  }
  return rows;
}

}  // namespace shiftmap::testing
