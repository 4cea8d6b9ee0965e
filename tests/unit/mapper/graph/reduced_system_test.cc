// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/reduced_system.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <optional>
#include <random>
#include <vector>

namespace shiftmap {
namespace {

Eigen::MatrixXd RandomInformation(Eigen::Index size, std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  const Eigen::MatrixXd A =
      Eigen::MatrixXd::NullaryExpr(size, size, [&](auto, auto) { return normal(random); });
  return A * A.transpose() + Eigen::MatrixXd::Identity(size, size);
}

// A chain of overlapping blocks, small enough for the dense factor and too large for it.
TEST(ReducedSystem, SolvesLikeADenseMatrix) {
  for (const int size : {9, 42, 600}) {
    std::mt19937_64 random(17);
    ReducedSystem reduced(size, 1);
    Eigen::MatrixXd H = Eigen::MatrixXd::Zero(size, size);
    Eigen::VectorXd b = Eigen::VectorXd::Zero(size);
    for (int first = 0; first + 6 <= size; first += 3) {
      const Eigen::MatrixXd block = RandomInformation(6, random);
      const Eigen::VectorXd right = block.col(0);
      reduced.Add({first + 3, first + 4, first + 5, first, first + 1, first + 2}, block, right);
      std::vector<int> order = {first + 3, first + 4, first + 5, first, first + 1, first + 2};
      for (int i = 0; i < 6; ++i) {
        b[order[static_cast<std::size_t>(i)]] += right[i];
        for (int j = 0; j < 6; ++j) {
          H(order[static_cast<std::size_t>(i)], order[static_cast<std::size_t>(j)]) += block(i, j);
        }
      }
    }
    const auto factor = reduced.Factorize();
    ASSERT_TRUE(factor);
    const Eigen::MatrixXd covariance = H.inverse();
    EXPECT_LT((factor->Solve(b) - covariance * b).norm(), 1e-8 * (1.0 + b.norm()));
    EXPECT_LT((factor->CovarianceBlock(3, 6) - covariance.block(3, 3, 6, 6)).norm(), 1e-9);
    // L⁻ᵀ of all unit vectors is a square root of the covariance.
    const Eigen::MatrixXd root = factor->SolveUpper(Eigen::MatrixXd::Identity(size, size));
    EXPECT_LT((root * root.transpose() - covariance).norm(), 1e-8);
  }
}

// A ring of overlapping blocks, each `factor` times its random information.
void AddRing(int size, const std::vector<double>& factors, ReducedSystem* reduced) {
  std::mt19937_64 random(29);
  reduced->Clear();
  for (int first = 0; first < size; first += 3) {
    std::vector<int> index;
    for (int i = 0; i < 6; ++i) index.push_back((first + i) % size);
    const Eigen::MatrixXd block = RandomInformation(6, random);
    const double factor = factors[static_cast<std::size_t>(first / 3) % factors.size()];
    reduced->Add(index, factor * block, block.col(0));
  }
}

// Another system than that of the factor: near it, far from it, and of another shape.
TEST(ReducedSystem, SolvesSimilarSystemsOnAnOldFactor) {
  constexpr int kSize = 600;
  ReducedSystem reduced(kSize, 1);
  AddRing(kSize, {1.0}, &reduced);
  ASSERT_TRUE(reduced.Solve());
  for (const std::vector<double>& factors :
       {std::vector<double>{1.0, 1.02, 0.97}, {1.0, 1e4, 1e-3}, {1.0, 1.01}}) {
    AddRing(kSize, factors, &reduced);
    const std::optional<Eigen::VectorXd> similar = reduced.Solve();
    ASSERT_TRUE(similar);
    ReducedSystem exact(kSize, 1);
    AddRing(kSize, factors, &exact);
    const Eigen::VectorXd expected = exact.Solve().value();
    EXPECT_LT((*similar - expected).norm(), 1e-5 * expected.norm());
  }
  AddRing(kSize, {1.0, -1.0}, &reduced);
  EXPECT_FALSE(reduced.Solve());
}

TEST(ReducedSystem, LeavesOutFixedRowsAndSaysWhatIsNotDetermined) {
  ReducedSystem reduced(2, 1);
  reduced.Add({-1, 1}, Eigen::Matrix2d{{5.0, 1.0}, {1.0, 2.0}}, Eigen::Vector2d(3.0, 4.0));
  EXPECT_FALSE(reduced.Factorize());
  ReducedSystem whole(2, 1);
  whole.Add({0, -1}, Eigen::Matrix2d{{5.0, 1.0}, {1.0, 2.0}}, Eigen::Vector2d(3.0, 4.0));
  whole.Add({-1, 1}, Eigen::Matrix2d{{5.0, 1.0}, {1.0, 2.0}}, Eigen::Vector2d(3.0, 4.0));
  const std::optional<Eigen::VectorXd> x = whole.Solve();
  ASSERT_TRUE(x);
  EXPECT_NEAR((*x)[0], 0.6, 1e-12);
  EXPECT_NEAR((*x)[1], 2.0, 1e-12);
}

}  // namespace
}  // namespace shiftmap
