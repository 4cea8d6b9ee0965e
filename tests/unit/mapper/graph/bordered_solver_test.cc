// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/bordered_solver.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <random>
#include <utility>
#include <vector>

#include "tests/support/random_map.h"
#include "tests/unit/mapper/graph/chain_system.h"

namespace shiftmap {
namespace {

constexpr int kBefore = 90;  // Unknowns before the border, and after it.
constexpr int kAfter = 60;
constexpr Border kBorder{kBefore, 30, 3};
constexpr int kSize = kBefore + 90 + kAfter;

struct System {
  std::vector<SystemTerm> terms;
  Eigen::MatrixXd dense = Eigen::MatrixXd::Zero(kSize, kSize);
  Eigen::VectorXd b = Eigen::VectorXd::Zero(kSize);
};

// Terms over near unknowns outside the border and one of its blocks.
System RandomSystem(std::mt19937_64& random) {
  System system;
  std::normal_distribution<double> normal;
  const auto outside = [](int i) { return i < kBefore ? i : i + kBorder.end() - kBefore; };
  for (int t = 0; t < 300; ++t) {
    SystemTerm term;
    for (int k = 0; k < 4; ++k) term.index.push_back(outside((t + k) % (kBefore + kAfter)));
    for (int k = 0; k < kBorder.size; ++k) {
      term.index.push_back(kBorder.begin + (t / 10) * kBorder.size + k);
    }
    term.index.push_back(-1);
    const auto size = static_cast<Eigen::Index>(term.index.size());
    const Eigen::MatrixXd A =
        Eigen::MatrixXd::NullaryExpr(size, size, [&](auto, auto) { return normal(random); });
    term.H = A * A.transpose();
    for (Eigen::Index i = 0; i + 1 < size; ++i) {
      for (Eigen::Index j = 0; j + 1 < size; ++j) {
        system.dense(term.index[static_cast<std::size_t>(i)],
                     term.index[static_cast<std::size_t>(j)]) += term.H(i, j);
      }
    }
    system.terms.push_back(std::move(term));
  }
  for (double& value : system.b) value = normal(random);
  return system;
}

// The dense system without the border.
Eigen::MatrixXd Held(const System& system) {
  std::vector<int> rows;
  for (int i = 0; i < kSize; ++i) {
    if (i < kBorder.begin || i >= kBorder.end()) rows.push_back(i);
  }
  Eigen::MatrixXd inverse = Eigen::MatrixXd::Zero(kSize, kSize);
  const Eigen::MatrixXd A = system.dense(rows, rows);
  const Eigen::MatrixXd inverse_A = A.inverse();
  inverse(rows, rows) = inverse_A;
  return inverse;
}

TEST(BorderedSolver, SolvesLikeADenseMatrixAndOnAnOldFactor) {
  std::mt19937_64 random(testing::TestSeed(75));
  System system = RandomSystem(random);
  BorderedSolver solver(kSize, kBorder);
  for (const double scale : {1.0, 1.3}) {
    for (std::size_t t = 0; t < system.terms.size(); t += 2) {
      for (std::size_t i = 0; i + 1 < system.terms[t].index.size(); ++i) {
        for (std::size_t j = 0; j + 1 < system.terms[t].index.size(); ++j) {
          system.dense(system.terms[t].index[i], system.terms[t].index[j]) +=
              (scale - 1.0) *
              system.terms[t].H(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j));
        }
      }
      system.terms[t].H *= scale;
    }
    const Eigen::VectorXd expected = system.dense.llt().solve(system.b);
    const auto x = solver.Solve(system.terms, system.b);
    ASSERT_TRUE(x.has_value());
    const Eigen::VectorXd error = x->col(0) - expected;
    EXPECT_LT(error.dot(system.dense * error), 1e-6 * expected.dot(system.dense * expected));
  }
}

TEST(BorderedSolver, DrawsHaveTheCovariance) {
  std::mt19937_64 random(testing::TestSeed(76));
  const System system = RandomSystem(random);
  BorderedSolver solver(kSize, kBorder);
  constexpr int kDraws = 2000;
  const auto draws = solver.Draw(system.terms, kDraws, random);
  ASSERT_TRUE(draws.has_value());
  // x ~ N(0, H⁻¹): xᵀ H x is χ² of as many degrees of freedom as there are unknowns.
  const Eigen::VectorXd squares =
      draws->cwiseProduct(system.dense * *draws).colwise().sum().transpose();
  EXPECT_NEAR(squares.mean(), kSize, 4.0 * std::sqrt(2.0 * kSize / kDraws));
  const Eigen::MatrixXd inverse = system.dense.inverse();
  for (int i = 0; i < kSize; i += 7) {
    EXPECT_NEAR(draws->row(i).squaredNorm() / kDraws / inverse(i, i), 1.0, 0.17) << i;
  }
}

TEST(BorderedSolver, TellsTheBorderApart) {
  std::mt19937_64 random(testing::TestSeed(77));
  const System system = RandomSystem(random);
  BorderedSolver solver(kSize, kBorder);
  ASSERT_TRUE(solver.Factorize(system.terms));
  const int width = kBorder.end() - kBorder.begin;
  const Eigen::MatrixXd E = Eigen::MatrixXd::Random(width, 2);
  const Eigen::MatrixXd covariance =
      system.dense.inverse().block(kBorder.begin, kBorder.begin, width, width);
  EXPECT_LT((covariance * solver.BorderInformationTimes(system.terms, E) - E).norm(), 1e-8);
  const Eigen::MatrixXd held = Held(system);
  const Eigen::MatrixXd expected = -held * system.dense.middleCols(kBorder.begin, width) * E;
  EXPECT_LT((solver.FollowBorder(system.terms, E) - expected).norm(), 1e-8 * expected.norm());
  int visited = 0;
  solver.VisitInverse([&](const std::vector<int>& unknowns, int own, const Eigen::MatrixXd& Z) {
    for (int i = 0; i < own; ++i, ++visited) {
      const int unknown = unknowns[static_cast<std::size_t>(i)];
      EXPECT_NEAR(Z(i, i), held(unknown, unknown), 1e-9);
    }
  });
  EXPECT_EQ(visited, kBefore + kAfter);
}

TEST(BorderedSolver, SolvesChainsLikeADenseMatrix) {
  std::mt19937_64 random(testing::TestSeed(78));
  const testing::ChainSystem system = testing::MakeChainSystem(4, random);
  const Eigen::MatrixXd H = system.Dense();
  const Eigen::MatrixXd b = Eigen::MatrixXd::Random(testing::kSize, 2);
  BorderedSolver solver(testing::kSize, testing::kBorder);
  const auto x = solver.Solve(system.terms, b, 1e-6);
  ASSERT_TRUE(x.has_value());
  const Eigen::MatrixXd expected = H.llt().solve(b);
  EXPECT_LT((*x - expected).norm(), 1e-5 * expected.norm());
}

// With chains cut it is the inverse of what stands in for A.
TEST(BorderedSolver, TellsTheInverseWhereChainsAreCut) {
  std::mt19937_64 random(testing::TestSeed(83));
  constexpr int kSystem = testing::kSize;
  const testing::ChainSystem system = testing::MakeChainSystem(4, random);
  BorderedSolver solver(kSystem, testing::kBorder);
  ASSERT_TRUE(solver.Solve(system.terms, Eigen::VectorXd::Ones(kSystem)));
  const Eigen::MatrixXd inverse = solver.SolveHeld(Eigen::MatrixXd::Identity(kSystem, kSystem));
  std::vector<bool> told(kSystem);
  solver.VisitInverse([&](const std::vector<int>& unknowns, int own, const Eigen::MatrixXd& Z) {
    for (int j = 0; j < own; ++j) {
      told[static_cast<std::size_t>(unknowns[static_cast<std::size_t>(j)])] = true;
      for (std::size_t i = 0; i < unknowns.size(); ++i) {
        EXPECT_NEAR(Z(static_cast<Eigen::Index>(i), j),
                    inverse(unknowns[i], unknowns[static_cast<std::size_t>(j)]),
                    1e-9);
      }
    }
  });
  for (int i = testing::kFirstMode; i < kSystem; ++i) {
    EXPECT_TRUE(told[static_cast<std::size_t>(i)]) << i;
  }
  constexpr std::size_t kFifthPose = std::size_t{4} * kChainRows;
  EXPECT_FALSE(told[kFifthPose]);  // Something was cut.

  const std::vector<int> index = {
      testing::kFirstMode + 4, testing::kFirstCalibration, testing::kFirstMode + 31};
  const Eigen::MatrixXd weights = Eigen::MatrixXd::Random(3, 2);
  Eigen::MatrixXd all = Eigen::MatrixXd::Zero(kSystem, 2);
  all(index, Eigen::all) = weights;
  all.middleRows(testing::kFirstCalibration, 2 * testing::kChains).setZero();
  EXPECT_LT((solver.QuadraticForm(index, weights) - all.transpose() * inverse * all).norm(), 1e-9);

  constexpr int kDraws = 20'000;
  std::normal_distribution<double> normal;
  const Eigen::MatrixXd z = Eigen::MatrixXd::NullaryExpr(
      solver.factored_size(), kDraws, [&](auto, auto) { return normal(random); });
  const Eigen::MatrixXd draws = solver.DrawTail(kSystem - testing::kFirstMode, z);
  for (int i = testing::kFirstMode; i < kSystem; i += 9) {
    const auto row = draws.row(i - testing::kFirstMode);
    EXPECT_NEAR(row.squaredNorm() / kDraws / inverse(i, i), 1.0, 0.06) << i;
  }
}

}  // namespace
}  // namespace shiftmap
