// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/chain_preconditioner.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cstddef>
#include <random>
#include <utility>
#include <vector>

#include "tests/support/random_map.h"

namespace shiftmap {
namespace {

constexpr int kPoses = 24;  // Of each chain.
constexpr int kChains = 3;
constexpr int kModes = 24;
constexpr int kFirstCalibration = kChainRows * kPoses * kChains;
constexpr Border kBorder{kFirstCalibration, kChains, 2, true};
constexpr int kFirstMode = kFirstCalibration + 2 * kChains;
constexpr int kSize = kFirstMode + 2 * kModes;

struct System {
  std::vector<SystemTerm> terms;
  Eigen::MatrixXd held = Eigen::MatrixXd::Zero(kSize, kSize);  // Rows of the border zero.
};

// Terms between neighbouring poses of each chain, with the chain's calibration and `seen` modes.
System MakeSystem(int seen, std::mt19937_64& random) {
  System system;
  std::normal_distribution<double> normal;
  for (int chain = 0; chain < kChains; ++chain) {
    for (int i = 0; i + 1 < kPoses; ++i) {
      SystemTerm term;
      for (int row = 0; row < 2 * kChainRows; ++row) {
        term.index.push_back(kChainRows * (chain * kPoses + i) + row);
      }
      for (int row = 0; row < 2; ++row) term.index.push_back(kFirstCalibration + 2 * chain + row);
      for (int k = 0; k < seen; ++k) {
        const int mode = (i + k) % kModes;
        term.index.push_back(kFirstMode + 2 * mode);
        term.index.push_back(kFirstMode + 2 * mode + 1);
      }
      const auto size = static_cast<Eigen::Index>(term.index.size());
      const Eigen::MatrixXd J =
          Eigen::MatrixXd::NullaryExpr(size, size, [&](auto, auto) { return normal(random); });
      term.H = J * J.transpose();
      for (Eigen::Index a = 0; a < size; ++a) {
        for (Eigen::Index b = 0; b < size; ++b) {
          const int row = term.index[static_cast<std::size_t>(a)];
          const int column = term.index[static_cast<std::size_t>(b)];
          const auto outside = [](int unknown) {
            return unknown < kBorder.begin || unknown >= kBorder.end();
          };
          if (outside(row) && outside(column)) system.held(row, column) += term.H(a, b);
        }
      }
      system.terms.push_back(std::move(term));
    }
  }
  return system;
}

std::vector<int> RowsOutside() {
  std::vector<int> rows;
  for (int i = 0; i < kSize; ++i) {
    if (i < kBorder.begin || i >= kBorder.end()) rows.push_back(i);
  }
  return rows;
}

Eigen::MatrixXd Inverse(const ChainPreconditioner& preconditioner) {
  return preconditioner.Solve(Eigen::MatrixXd::Identity(kSize, kSize));
}

TEST(ChainPreconditioner, IsExactWhereNothingIsCut) {
  std::mt19937_64 random(testing::TestSeed(81));
  const System system = MakeSystem(3, random);
  ChainPreconditioner preconditioner(
      kSize, kBorder, std::vector<bool>(static_cast<std::size_t>(kPoses * kChains), true));
  ASSERT_TRUE(preconditioner.Factorize(system.terms));
  const std::vector<int> rows = RowsOutside();
  const Eigen::MatrixXd inverse = Inverse(preconditioner)(rows, rows);
  const Eigen::MatrixXd A = system.held(rows, rows);
  EXPECT_LT((inverse * A - Eigen::MatrixXd::Identity(A.rows(), A.cols())).norm(), 1e-7);
}

// Less is known where chains are cut, never more: A - P is positive semidefinite, and zero for what
// is not cut.
TEST(ChainPreconditioner, SaysNoMoreThanTheSystem) {
  std::mt19937_64 random(testing::TestSeed(82));
  const System system = MakeSystem(4, random);
  ChainPreconditioner preconditioner(kSize, kBorder);
  ASSERT_TRUE(preconditioner.Factorize(system.terms));
  const std::vector<int> rows = RowsOutside();
  const Eigen::MatrixXd inverse = Inverse(preconditioner)(rows, rows);
  EXPECT_LT((inverse - inverse.transpose()).norm(), 1e-9 * inverse.norm());
  const Eigen::MatrixXd A = system.held(rows, rows);
  const Eigen::VectorXd eigenvalues =
      Eigen::GeneralizedSelfAdjointEigenSolver<Eigen::MatrixXd>(inverse, A.inverse()).eigenvalues();
  EXPECT_GT(eigenvalues.minCoeff(), 1.0 - 1e-7);
  EXPECT_GT(eigenvalues.maxCoeff(), 1.0 + 1e-3);  // Something was cut.
}

TEST(ChainPreconditioner, TellsTheInverseOfItsModes) {
  std::mt19937_64 random(testing::TestSeed(83));
  const System system = MakeSystem(4, random);
  ChainPreconditioner preconditioner(kSize, kBorder);
  ASSERT_TRUE(preconditioner.Factorize(system.terms));
  const Eigen::MatrixXd inverse = Inverse(preconditioner);
  std::vector<bool> told(kSize);
  preconditioner.VisitInverse(
      [&](const std::vector<int>& unknowns, int own, const Eigen::MatrixXd& Z) {
        for (int j = 0; j < own; ++j) {
          told[static_cast<std::size_t>(unknowns[static_cast<std::size_t>(j)])] = true;
          for (std::size_t i = 0; i < unknowns.size(); ++i) {
            EXPECT_NEAR(Z(static_cast<Eigen::Index>(i), j),
                        inverse(unknowns[i], unknowns[static_cast<std::size_t>(j)]),
                        1e-9);
          }
        }
      });
  for (int i = kFirstMode; i < kSize; ++i) EXPECT_TRUE(told[static_cast<std::size_t>(i)]) << i;

  const std::vector<int> index = {kFirstMode + 4, kFirstCalibration, kFirstMode + 31};
  const Eigen::MatrixXd weights = Eigen::MatrixXd::Random(3, 2);
  Eigen::MatrixXd all = Eigen::MatrixXd::Zero(kSize, 2);
  all(index, Eigen::all) = weights;
  all.middleRows(kFirstCalibration, 2 * kChains).setZero();
  EXPECT_LT((preconditioner.QuadraticForm(index, weights) - all.transpose() * inverse * all).norm(),
            1e-9);

  constexpr int kDraws = 20'000;
  std::normal_distribution<double> normal;
  const Eigen::MatrixXd z =
      Eigen::MatrixXd::NullaryExpr(kSize, kDraws, [&](auto, auto) { return normal(random); });
  const Eigen::MatrixXd draws = preconditioner.SolveUpper(z);
  for (int i = kFirstMode; i < kSize; i += 9) {
    EXPECT_NEAR(draws.row(i).squaredNorm() / kDraws / inverse(i, i), 1.0, 0.06) << i;
  }
}

// Terms that have no mode in common, nor with other chains, hang together by their poses alone.
TEST(ChainPreconditioner, LeavesPosesThatHoldTermsTogether) {
  std::mt19937_64 random(testing::TestSeed(84));
  System system = MakeSystem(1, random);
  for (SystemTerm& term : system.terms) {
    const int chain = (term.index[2 * kChainRows] - kFirstCalibration) / 2;
    for (std::size_t i = 2 * kChainRows + 2; i < term.index.size(); ++i) {
      const int mode = (term.index[i] - kFirstMode) / 2;
      term.index[i] = kFirstMode + 2 * (mode % 8 + 8 * chain) + (term.index[i] - kFirstMode) % 2;
    }
  }
  system.held.setZero();
  for (const SystemTerm& term : system.terms) {
    for (std::size_t a = 0; a < term.index.size(); ++a) {
      for (std::size_t b = 0; b < term.index.size(); ++b) {
        system.held(term.index[a], term.index[b]) +=
            term.H(static_cast<Eigen::Index>(a), static_cast<Eigen::Index>(b));
      }
    }
  }
  ChainPreconditioner preconditioner(kSize, kBorder);
  ASSERT_TRUE(preconditioner.Factorize(system.terms));
  const std::vector<int> rows = RowsOutside();
  const Eigen::MatrixXd inverse = Inverse(preconditioner)(rows, rows);
  const Eigen::MatrixXd A = system.held(rows, rows);
  EXPECT_LT((inverse * A - Eigen::MatrixXd::Identity(A.rows(), A.cols())).norm(), 1e-6);
}

TEST(ChainPreconditioner, RefusesTermsOfPosesThatAreNoNeighbours) {
  std::mt19937_64 random(testing::TestSeed(85));
  System system = MakeSystem(4, random);
  std::swap_ranges(system.terms[0].index.begin(),
                   system.terms[0].index.begin() + kChainRows,
                   system.terms[5].index.begin());
  EXPECT_FALSE(ChainPreconditioner(kSize, kBorder).Factorize(system.terms));
}

}  // namespace
}  // namespace shiftmap
