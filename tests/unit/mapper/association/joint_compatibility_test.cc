// SPDX-License-Identifier: Apache-2.0
#include "mapper/association/joint_compatibility.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <random>

#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

// A scan in the plane with H = [-I I]: everything is off by one common error, as by that of the
// pose, and by errors of its own.
struct Scene {
  std::vector<Eigen::Vector2d> landmarks;
  std::vector<Eigen::Vector2d> seen;
  double sd_common = 1.0;
  double sd_own = 0.1;
};

CompatibilityProblem MakeProblem(const Scene& scene) {
  CompatibilityProblem problem;
  problem.observations = static_cast<int>(scene.seen.size());
  std::vector<Eigen::Vector2d> nu;
  for (std::size_t i = 0; i < scene.seen.size(); ++i) {
    for (std::size_t j = 0; j < scene.landmarks.size(); ++j) {
      problem.candidates.push_back({static_cast<int>(i), static_cast<int>(j)});
      nu.push_back(scene.seen[i] - scene.landmarks[j]);
    }
  }
  const auto count = static_cast<Eigen::Index>(nu.size());
  problem.nu.resize(2 * count);
  problem.covariance.resize(2 * count, 2 * count);
  for (Eigen::Index a = 0; a < count; ++a) {
    problem.nu.segment<2>(2 * a) = nu[static_cast<std::size_t>(a)];
    for (Eigen::Index b = 0; b < count; ++b) {
      const double variance =
          scene.sd_common * scene.sd_common + (a == b ? scene.sd_own * scene.sd_own : 0.0);
      problem.covariance.block<2, 2>(2 * a, 2 * b) = Eigen::Matrix2d::Identity() * variance;
    }
  }
  return problem;
}

double JointDistance(const CompatibilityProblem& problem, const std::vector<int>& candidates) {
  const auto size = static_cast<Eigen::Index>(2 * candidates.size());
  Eigen::VectorXd nu(size);
  Eigen::MatrixXd S(size, size);
  for (Eigen::Index a = 0; a < size / 2; ++a) {
    const int c = candidates[static_cast<std::size_t>(a)];
    nu.segment<2>(2 * a) = problem.nu.segment<2>(2 * c);
    for (Eigen::Index b = 0; b < size / 2; ++b) {
      S.block<2, 2>(2 * a, 2 * b) =
          problem.covariance.block<2, 2>(2 * c, 2 * candidates[static_cast<std::size_t>(b)]);
    }
  }
  return size == 0 ? 0.0 : nu.dot(S.inverse() * nu);
}

// Every hypothesis, with every distance from the full inverse.
void Enumerate(const CompatibilityProblem& problem,
               double gate_probability,
               int observation,
               std::vector<int>* chosen,
               JointAssociation* best) {
  if (observation == problem.observations) {
    const double distance = JointDistance(problem, *chosen);
    const auto pairings = static_cast<int>(chosen->size());
    if (pairings < best->pairings ||
        (pairings == best->pairings && pairings > 0 && distance >= best->squared_distance)) {
      return;
    }
    best->pairings = pairings;
    best->squared_distance = distance;
    best->candidates.assign(static_cast<std::size_t>(problem.observations), -1);
    for (const int c : *chosen) {
      const auto at = static_cast<std::size_t>(c);
      best->candidates[static_cast<std::size_t>(problem.candidates[at].observation)] = c;
    }
    return;
  }
  for (int c = 0; c < static_cast<int>(problem.candidates.size()); ++c) {
    const CompatibilityProblem::Candidate& pair = problem.candidates[static_cast<std::size_t>(c)];
    if (pair.observation != observation) continue;
    bool used = false;
    for (const int other : *chosen) {
      used |= problem.candidates[static_cast<std::size_t>(other)].landmark == pair.landmark;
    }
    if (used) continue;
    const bool compatible_alone =
        JointDistance(problem, {c}) <= ChiSquareQuantile(gate_probability, 2);
    chosen->push_back(c);
    if (compatible_alone &&
        JointDistance(problem, *chosen) <=
            ChiSquareQuantile(gate_probability, static_cast<int>(2 * chosen->size()))) {
      Enumerate(problem, gate_probability, observation + 1, chosen, best);
    }
    chosen->pop_back();
  }
  Enumerate(problem, gate_probability, observation + 1, chosen, best);
}

Scene RandomScene(std::mt19937_64* random) {
  std::uniform_real_distribution<double> place(0.0, 6.0);
  std::normal_distribution<double> normal;
  std::uniform_int_distribution<int> count(1, 5);
  Scene scene;
  const int landmarks = count(*random);
  for (int i = 0; i < landmarks; ++i) scene.landmarks.emplace_back(place(*random), place(*random));
  const Eigen::Vector2d common(normal(*random), normal(*random));
  for (const Eigen::Vector2d& landmark : scene.landmarks) {
    if (place(*random) < 1.5) continue;
    scene.seen.push_back(landmark + common +
                         scene.sd_own * Eigen::Vector2d(normal(*random), normal(*random)));
  }
  const int clutter = count(*random) - 3;
  for (int i = 0; i < clutter; ++i) scene.seen.emplace_back(place(*random), place(*random));
  std::shuffle(scene.seen.begin(), scene.seen.end(), *random);
  return scene;
}

TEST(JointCompatibility, FindsWhatEnumerationFinds) {
  std::mt19937_64 random(4);
  int with_pairings = 0;
  for (int trial = 0; trial < 300; ++trial) {
    const CompatibilityProblem problem = MakeProblem(RandomScene(&random));
    const JointAssociation found = AssociateJointly(problem, {});
    JointAssociation expected;
    expected.candidates.assign(static_cast<std::size_t>(problem.observations), -1);
    std::vector<int> chosen;
    Enumerate(problem, CompatibilityOptions().gate_probability, 0, &chosen, &expected);
    ASSERT_TRUE(found.complete);
    ASSERT_EQ(found.pairings, expected.pairings) << trial;
    EXPECT_NEAR(found.squared_distance, expected.squared_distance, 1e-9) << trial;
    EXPECT_EQ(found.candidates, expected.candidates) << trial;
    with_pairings += found.pairings > 0;
  }
  EXPECT_GT(with_pairings, 200);
}

// The classic case: everything appears shifted by half the spacing of a row of landmarks and a bit
// more, so that each observation is nearer to the neighbour of its landmark than to its own. Only
// the one at the end, whose "neighbour" is not there, tells.
TEST(JointCompatibility, WinsWhereNearestNeighboursAreAllWrong) {
  Scene scene;
  for (const double x : {0.0, 2.0, 4.0, 7.0}) scene.landmarks.emplace_back(x, 0.0);
  for (const Eigen::Vector2d& landmark : scene.landmarks) {
    scene.seen.push_back(landmark + Eigen::Vector2d(1.2, 0.0));
  }
  const CompatibilityProblem problem = MakeProblem(scene);
  const auto right = [&](const JointAssociation& association) {
    int count = 0;
    for (const int c : association.candidates) {
      if (c < 0) continue;
      const auto& pair = problem.candidates[static_cast<std::size_t>(c)];
      count += pair.observation == pair.landmark;
    }
    return count;
  };
  EXPECT_EQ(right(AssociateJointly(problem, {})), 4);
  EXPECT_EQ(right(AssociateNearest(problem, {})), 1);
}

TEST(JointCompatibility, DoesNotDependOnTheFrame) {
  std::mt19937_64 random(9);
  const Scene scene = RandomScene(&random);
  Scene moved = scene;
  const Eigen::Matrix2d R = Eigen::Rotation2Dd(0.7).toRotationMatrix();
  for (auto* points : {&moved.landmarks, &moved.seen}) {
    for (Eigen::Vector2d& p : *points) p = R * p + Eigen::Vector2d(3.0, -2.0);
  }
  const JointAssociation a = AssociateJointly(MakeProblem(scene), {});
  const JointAssociation b = AssociateJointly(MakeProblem(moved), {});
  EXPECT_EQ(a.candidates, b.candidates);
  EXPECT_NEAR(a.squared_distance, b.squared_distance, 1e-9);
}

TEST(JointCompatibility, ABoundOnNodesLeavesTheFirstDescent) {
  Scene scene;
  scene.sd_common = 3.0;
  for (int i = 0; i < 9; ++i) scene.landmarks.emplace_back(0.6 * i, 0.3 * (i % 2));
  for (const Eigen::Vector2d& landmark : scene.landmarks) {
    scene.seen.push_back(landmark + Eigen::Vector2d(0.35, 0.1));
  }
  const CompatibilityProblem problem = MakeProblem(scene);
  const JointAssociation bounded = AssociateJointly(problem, {.max_nodes = 1});
  const JointAssociation full = AssociateJointly(problem, {});
  EXPECT_FALSE(bounded.complete);
  EXPECT_GT(bounded.pairings, 0);
  EXPECT_LE(bounded.pairings, full.pairings);
  EXPECT_EQ(full.pairings, 9);
  // What it pairs is jointly compatible all the same.
  std::vector<int> chosen;
  for (const int c : bounded.candidates) {
    if (c >= 0) chosen.push_back(c);
  }
  EXPECT_NEAR(JointDistance(problem, chosen), bounded.squared_distance, 1e-9);
}

TEST(JointCompatibility, NothingToPair) {
  EXPECT_EQ(AssociateJointly({}, {}).pairings, 0);
  CompatibilityProblem problem;
  problem.observations = 2;
  EXPECT_EQ(AssociateJointly(problem, {}).candidates, (std::vector<int>{-1, -1}));
  EXPECT_EQ(AssociateNearest(problem, {}).candidates, (std::vector<int>{-1, -1}));
}

}  // namespace
}  // namespace shiftmap
