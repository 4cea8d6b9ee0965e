// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/chain_elimination.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cstddef>
#include <random>
#include <utility>
#include <vector>

#include "tests/support/random_map.h"
#include "tests/unit/mapper/graph/chain_system.h"

namespace shiftmap {
namespace {

using testing::ChainSystem;
using testing::kBorder;
using testing::kChains;
using testing::kFirstCalibration;
using testing::kFirstMode;
using testing::kPoses;
using testing::kSize;
using testing::MakeChainSystem;
using testing::RowsOutside;

// The inverse with the border held and M in the place of S; zero in the border.
Eigen::MatrixXd InverseByCuts(const ChainElimination& elimination, const ChainSystem& system) {
  Multifrontal factor(static_cast<int>(elimination.others().size()), elimination.ShapeOfCutTerms());
  const auto terms = elimination.CutTerms(system.terms);
  EXPECT_TRUE(terms && factor.Factorize(*terms));
  ChainElimination::Parts parts = elimination.Split(Eigen::MatrixXd::Identity(kSize, kSize));
  elimination.Reduce(true, &parts);
  parts.others = factor.Solve(parts.others);
  elimination.Complete(true, &parts);
  return elimination.Join(parts);
}

// Chains that pass where one is cut: at all poses, at half of them, only at the ends.
constexpr int kSome = kChains - 1;
constexpr int kMany = kChains;
constexpr int kMoreThanThereAre = kChains + 1;

ChainElimination Eliminated(const ChainSystem& system, int min_chains = kSome) {
  auto elimination = ChainElimination::OfPoses(kSize, kBorder, system.terms, min_chains);
  EXPECT_TRUE(elimination && elimination->Eliminate(system.terms));
  return *std::move(elimination);
}

TEST(ChainElimination, LeavesTheSchurComplement) {
  std::mt19937_64 random(testing::TestSeed(86));
  const ChainSystem system = MakeChainSystem(4, random);
  const Eigen::MatrixXd H = system.Dense();
  const Eigen::MatrixXd b = Eigen::MatrixXd::Random(kSize, 3);
  for (const ChainElimination& elimination :
       {Eliminated(system), Eliminated(system, kMany), Eliminated(system, kMoreThanThereAre)}) {
    for (const bool held : {false, true}) {
      ChainElimination::Parts parts = elimination.Split(b);
      EXPECT_EQ(elimination.Join(parts), b);
      elimination.Reduce(held, &parts);
      const auto others = std::ssize(elimination.others());
      const Eigen::MatrixXd S = elimination.Times(held, Eigen::MatrixXd::Identity(others, others));
      parts.others = S.llt().solve(parts.others);
      elimination.Complete(held, &parts);
      Eigen::MatrixXd expected = Eigen::MatrixXd::Zero(kSize, 3);
      if (held) {
        const std::vector<int> rows = RowsOutside();
        const Eigen::MatrixXd A = H(rows, rows);
        const Eigen::MatrixXd b_outside = b(rows, Eigen::all);
        const Eigen::MatrixXd x = A.llt().solve(b_outside);
        expected(rows, Eigen::all) = x;
      } else {
        expected = H.llt().solve(b);
      }
      EXPECT_LT((elimination.Join(parts) - expected).norm(), 1e-7 * expected.norm());
    }
  }
}

TEST(ChainElimination, IsExactWhereNothingIsCut) {
  std::mt19937_64 random(testing::TestSeed(81));
  const ChainSystem system = MakeChainSystem(3, random);
  const std::vector<int> rows = RowsOutside();
  const Eigen::MatrixXd A = system.Dense()(rows, rows);
  ChainElimination of_border = ChainElimination::OfBorder(kSize, kBorder, system.terms);
  ASSERT_TRUE(of_border.Eliminate(system.terms));
  for (const ChainElimination& elimination :
       {Eliminated(system, kMoreThanThereAre), std::move(of_border)}) {
    const Eigen::MatrixXd inverse = InverseByCuts(elimination, system)(rows, rows);
    EXPECT_LT((inverse * A - Eigen::MatrixXd::Identity(A.rows(), A.cols())).norm(), 1e-7);
  }
}

// Less is known where chains are cut, never more: A - P is positive semidefinite, and zero for what
// is not cut.
TEST(ChainElimination, CutTermsSayNoMoreThanTheSystem) {
  std::mt19937_64 random(testing::TestSeed(82));
  const ChainSystem system = MakeChainSystem(4, random);
  const std::vector<int> rows = RowsOutside();
  const Eigen::MatrixXd inverse = InverseByCuts(Eliminated(system), system)(rows, rows);
  EXPECT_LT((inverse - inverse.transpose()).norm(), 1e-9 * inverse.norm());
  const Eigen::MatrixXd A = system.Dense()(rows, rows);
  const Eigen::VectorXd eigenvalues =
      Eigen::GeneralizedSelfAdjointEigenSolver<Eigen::MatrixXd>(inverse, A.inverse()).eigenvalues();
  EXPECT_GT(eigenvalues.minCoeff(), 1.0 - 1e-7);
  EXPECT_GT(eigenvalues.maxCoeff(), 1.0 + 1e-3);  // Something was cut.
}

TEST(ChainElimination, CutsWhereManyPass) {
  std::mt19937_64 random(testing::TestSeed(87));
  const ChainSystem system = MakeChainSystem(4, random);
  const auto cuts = [&](int min_chains) {
    const auto uncut =
        std::ssize(ChainElimination::OfBorder(kSize, kBorder, system.terms).others());
    return (uncut - std::ssize(Eliminated(system, min_chains).others())) / kChainRows;
  };
  EXPECT_EQ(cuts(kSome), kPoses * kChains);
  EXPECT_EQ(cuts(kMoreThanThereAre), 2 * kChains);
  EXPECT_GT(cuts(kMany), 2 * kChains);
  EXPECT_LT(cuts(kMany), kPoses * kChains);
}

// Terms that have no mode in common, nor with other chains, hang together by their poses alone.
TEST(ChainElimination, LeavesPosesThatHoldTermsTogether) {
  std::mt19937_64 random(testing::TestSeed(84));
  ChainSystem system = MakeChainSystem(1, random);
  for (SystemTerm& term : system.terms) {
    constexpr std::size_t kPoseRows = std::size_t{2} * kChainRows;
    const int chain = (term.index[kPoseRows] - kFirstCalibration) / 2;
    for (std::size_t i = kPoseRows + 2; i < term.index.size(); ++i) {
      const int mode = (term.index[i] - kFirstMode) / 2;
      term.index[i] = kFirstMode + 2 * (mode % 5 + 5 * chain) + (term.index[i] - kFirstMode) % 2;
    }
  }
  const std::vector<int> rows = RowsOutside();
  const Eigen::MatrixXd inverse = InverseByCuts(Eliminated(system), system)(rows, rows);
  const Eigen::MatrixXd A = system.Dense()(rows, rows);
  EXPECT_LT((inverse * A - Eigen::MatrixXd::Identity(A.rows(), A.cols())).norm(), 1e-6);
}

TEST(ChainElimination, RefusesTermsOfPosesThatAreNoNeighbours) {
  std::mt19937_64 random(testing::TestSeed(85));
  ChainSystem system = MakeChainSystem(4, random);
  std::swap_ranges(system.terms[0].index.begin(),
                   system.terms[0].index.begin() + kChainRows,
                   system.terms[5].index.begin());
  EXPECT_FALSE(ChainElimination::OfPoses(kSize, kBorder, system.terms, kSome));
}

}  // namespace
}  // namespace shiftmap
