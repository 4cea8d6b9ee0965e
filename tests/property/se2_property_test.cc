// SPDX-License-Identifier: Apache-2.0
//
// The laws that mapstore/geometry/se2.h states.
#include <gtest/gtest.h>

#include <numbers>
#include <random>

#include "mapstore/geometry/se2.h"
#include "tests/support/geometry_matchers.h"
#include "tests/support/random_map.h"

namespace shiftmap::testing {
namespace {

constexpr int kRounds = 1000;

class Se2LawTest : public ::testing::Test {
 protected:
  std::mt19937_64 random_{TestSeed(101)};

  double Uniform(double bound) {
    return std::uniform_real_distribution<double>(-bound, bound)(random_);
  }

  // Every third turns by less than the bound where the implementation takes a series.
  Eigen::Vector3d Twist() {
    const double yaw_bound = random_() % 3 == 0 ? 2e-4 : 0.999 * std::numbers::pi;
    return {Uniform(20.0), Uniform(20.0), Uniform(yaw_bound)};
  }

  Se2 Pose() { return Se2(Uniform(100.0), Uniform(100.0), Uniform(10.0)); }
};

TEST_F(Se2LawTest, Associativity) {
  for (int i = 0; i < kRounds; ++i) {
    const Se2 a = Pose();
    const Se2 b = Pose();
    const Se2 c = Pose();
    EXPECT_THAT((a * b) * c, IsNearPose(a * (b * c), 1e-11));
    const Eigen::Vector2d p(Uniform(50.0), Uniform(50.0));
    EXPECT_THAT((a * b) * p, IsNearMatrix(a * (b * p), 1e-11));
  }
}

TEST_F(Se2LawTest, InverseAndIdentity) {
  for (int i = 0; i < kRounds; ++i) {
    const Se2 T = Pose();
    EXPECT_THAT(T * T.Inverse(), IsNearPose(Se2(), 1e-12));
    EXPECT_THAT(T.Inverse() * T, IsNearPose(Se2(), 1e-12));
    EXPECT_THAT(T * Se2(), IsNearPose(T, 0.0));
  }
}

TEST_F(Se2LawTest, ExpAndLogAreInverse) {
  for (int i = 0; i < kRounds; ++i) {
    const Eigen::Vector3d twist = Twist();
    EXPECT_THAT(Se2::Exp(twist).Log(), IsNearMatrix(twist, 1e-9));
    const Se2 T = Pose();
    EXPECT_THAT(Se2::Exp(T.Log()), IsNearPose(T, 1e-9));
  }
}

TEST_F(Se2LawTest, TwistsAlongOneLineAdd) {
  for (int i = 0; i < kRounds; ++i) {
    const Eigen::Vector3d twist = Twist();
    const double share = Uniform(1.0);
    EXPECT_THAT(Se2::Exp(share * twist) * Se2::Exp((1.0 - share) * twist),
                IsNearPose(Se2::Exp(twist), 1e-11));
  }
}

TEST_F(Se2LawTest, AdjointMovesPerturbationsToTheLeft) {
  for (int i = 0; i < kRounds; ++i) {
    const Se2 T = Pose();
    const Eigen::Vector3d twist = 0.1 * Twist();
    EXPECT_THAT(T * Se2::Exp(twist), IsNearPose(Se2::Exp(T.Adjoint() * twist) * T, 1e-11));
  }
}

TEST_F(Se2LawTest, RightJacobianIsTheDerivativeOfExp) {
  constexpr double kStep = 1e-5;
  for (int i = 0; i < kRounds; ++i) {
    const Eigen::Vector3d twist = Twist();
    const Se2 inverse = Se2::Exp(twist).Inverse();
    Eigen::Matrix3d numeric;
    for (Eigen::Index j = 0; j < 3; ++j) {
      const Eigen::Vector3d step = kStep * Eigen::Vector3d::Unit(j);
      numeric.col(j) =
          ((inverse * Se2::Exp(twist + step)).Log() - (inverse * Se2::Exp(twist - step)).Log()) /
          (2.0 * kStep);
    }
    EXPECT_THAT(Se2::RightJacobian(twist), IsNearMatrix(numeric, 1e-7)) << twist.transpose();
  }
}

}  // namespace
}  // namespace shiftmap::testing
