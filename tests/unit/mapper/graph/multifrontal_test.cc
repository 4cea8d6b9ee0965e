// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/multifrontal.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <algorithm>
#include <memory>
#include <random>
#include <set>
#include <utility>
#include <vector>

#include "tests/support/random_map.h"

namespace shiftmap {
namespace {

struct System {
  int size = 0;
  std::vector<SystemTerm> terms;
  Eigen::MatrixXd dense;
};

// Terms over a few nodes each, of two or three unknowns, near each other on a ring or anywhere.
System RandomSystem(int nodes, int terms, bool local, std::mt19937_64& random) {
  System system;
  std::vector<int> begin;
  for (int node = 0; node < nodes; ++node) {
    begin.push_back(system.size);
    system.size += 2 + node % 2;
  }
  begin.push_back(system.size);
  system.dense = Eigen::MatrixXd::Zero(system.size, system.size);
  std::normal_distribution<double> normal;
  for (int t = 0; t < terms + nodes; ++t) {
    // The first terms determine every node.
    const int centre = t < nodes ? t : static_cast<int>(random() % static_cast<unsigned>(nodes));
    std::set<int> members = {centre};
    for (int k = 0; t >= nodes && k < 3; ++k) {
      const auto step = static_cast<int>(random() % (local ? 6U : static_cast<unsigned>(nodes)));
      members.insert((centre + step) % nodes);
    }
    SystemTerm term;
    for (const int node : members) {
      const auto at = static_cast<std::size_t>(node);
      for (int unknown = begin[at]; unknown < begin[at + 1]; ++unknown) {
        term.index.push_back(unknown);
      }
    }
    std::reverse(term.index.begin(), term.index.end());
    const auto size = static_cast<Eigen::Index>(term.index.size());
    const Eigen::MatrixXd A =
        Eigen::MatrixXd::NullaryExpr(size, size, [&](auto, auto) { return normal(random); });
    term.H = A * A.transpose();
    if (t < nodes) term.H += Eigen::MatrixXd::Identity(size, size);
    for (Eigen::Index i = 0; i < size; ++i) {
      for (Eigen::Index j = 0; j < size; ++j) {
        system.dense(term.index[static_cast<std::size_t>(i)],
                     term.index[static_cast<std::size_t>(j)]) += term.H(i, j);
      }
    }
    system.terms.push_back(std::move(term));
  }
  return system;
}

std::shared_ptr<const MultifrontalFactor> FactorOf(const System& system, int threads = 1) {
  return MultifrontalFactor::Of(
      std::make_shared<MultifrontalShape>(system.size, system.terms), system.terms, threads);
}

TEST(Multifrontal, SolvesLikeADenseMatrix) {
  std::mt19937_64 random(testing::TestSeed(71));
  for (const bool local : {true, false}) {
    const System system = RandomSystem(60, 80, local, random);
    const auto factor = FactorOf(system);
    ASSERT_TRUE(factor);
    const Eigen::MatrixXd inverse = system.dense.inverse();
    const Eigen::MatrixXd unit = Eigen::MatrixXd::Identity(system.size, system.size);
    EXPECT_LT((factor->Solve(unit) - inverse).norm(), 1e-9 * inverse.norm());
    const Eigen::MatrixXd root = factor->SolveUpper(unit);
    EXPECT_LT((root * root.transpose() - inverse).norm(), 1e-9 * inverse.norm());
  }
}

// Fronts of several panels, and more than one subtree.
TEST(Multifrontal, SolvesTheSameOnAnyNumberOfThreads) {
  std::mt19937_64 random(testing::TestSeed(75));
  for (const bool local : {true, false}) {
    const System system = RandomSystem(400, local ? 200 : 400, local, random);
    const MultifrontalShape shape(system.size, system.terms);
    std::size_t largest = 0;
    for (const auto& front : shape.fronts()) largest = std::max(largest, front.rows.size());
    EXPECT_GT(local ? shape.subtrees().size() : largest, local ? 1U : 400U);
    const auto factor = FactorOf(system);
    const auto threaded = FactorOf(system, 3);
    ASSERT_TRUE(factor && threaded);
    const Eigen::MatrixXd b = Eigen::MatrixXd::Random(system.size, 2);
    const Eigen::MatrixXd x = factor->Solve(b);
    EXPECT_LT((system.dense * x - b).norm(), 1e-9 * b.norm());
    EXPECT_EQ(threaded->Solve(b), x);
  }
}

TEST(Multifrontal, QuadraticFormIsThatOfTheInverse) {
  std::mt19937_64 random(testing::TestSeed(74));
  for (const bool local : {true, false}) {
    const System system = RandomSystem(60, 80, local, random);
    const auto factor = FactorOf(system);
    ASSERT_TRUE(factor);
    const Eigen::MatrixXd inverse = system.dense.inverse();
    const std::vector<int> unknowns = {system.size - 1, 3, system.size / 2};
    const Eigen::MatrixXd weights = Eigen::MatrixXd::Random(3, 2);
    const Eigen::MatrixXd expected = weights.transpose() * inverse(unknowns, unknowns) * weights;
    EXPECT_LT((factor->QuadraticForm(unknowns, weights) - expected).norm(), 1e-9 * expected.norm());
  }
}

TEST(Multifrontal, InverseHasEveryPairOfEveryTermOnce) {
  std::mt19937_64 random(testing::TestSeed(72));
  const System system = RandomSystem(60, 80, true, random);
  const auto factor = FactorOf(system);
  ASSERT_TRUE(factor);
  const Eigen::MatrixXd inverse = system.dense.inverse();
  std::set<std::pair<int, int>> pairs;
  factor->VisitInverse(
      [&](const std::vector<int>& unknowns, int own, const Eigen::MatrixXd& block) {
        for (int i = 0; i < own; ++i) {
          for (int j = i; j < static_cast<int>(unknowns.size()); ++j) {
            const std::pair<int, int> pair = std::minmax(unknowns[static_cast<std::size_t>(i)],
                                                         unknowns[static_cast<std::size_t>(j)]);
            EXPECT_TRUE(pairs.insert(pair).second) << pair.first << " " << pair.second;
            EXPECT_NEAR(block(i, j), inverse(pair.first, pair.second), 1e-9);
          }
        }
      });
  for (const SystemTerm& term : system.terms) {
    for (const int a : term.index) {
      for (const int b : term.index) EXPECT_TRUE(pairs.contains(std::minmax(a, b)));
    }
  }
  EXPECT_LT(pairs.size(), static_cast<std::size_t>(system.size * system.size / 2));
}

TEST(Multifrontal, SaysWhatIsNotPositiveDefinite) {
  std::mt19937_64 random(testing::TestSeed(73));
  System system = RandomSystem(20, 20, true, random);
  system.terms[3].H *= -1000.0;
  EXPECT_FALSE(FactorOf(system));
}

}  // namespace
}  // namespace shiftmap
