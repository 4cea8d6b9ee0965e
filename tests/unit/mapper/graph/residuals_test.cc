// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/residuals.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <random>

namespace shiftmap {
namespace {

MotionIncrement RandomMotion(std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  MotionIncrement motion;
  motion.T_begin_end = Se2::Exp({0.5, 0.1 * normal(random), 0.3 * normal(random)});
  Eigen::Matrix3d root;
  for (double& value : root.reshaped()) value = 0.1 * normal(random);
  motion.cov = root * root.transpose() + 1e-3 * Eigen::Matrix3d::Identity();
  return motion;
}

TEST(MotionResidual, HasUnitCovariance) {
  std::mt19937_64 random(1);
  std::normal_distribution<double> normal;
  for (int i = 0; i < 20; ++i) {
    const MotionIncrement motion = RandomMotion(random);
    const Eigen::Vector3d error =
        1e-4 * Eigen::Vector3d(normal(random), normal(random), normal(random));
    const Se2 T_map_i(1.0, 2.0, 0.7);
    const Eigen::Vector3d r = MotionResidual(motion)
                                  .At(T_map_i,
                                      T_map_i * motion.T_begin_end * Se2::Exp(error),
                                      Eigen::Vector3d::Zero(),
                                      0.0)
                                  .r;
    const double expected = error.dot(motion.cov.inverse() * error);
    EXPECT_NEAR(r.squaredNorm(), expected, 1e-4 * expected);
  }
}

// Or the noise of translation would be found by what turns do.
TEST(MotionResidual, TheThirdRowIsYawAlone) {
  std::mt19937_64 random(2);
  std::normal_distribution<double> normal;
  for (int i = 0; i < 20; ++i) {
    const MotionIncrement motion = RandomMotion(random);
    const double yaw = 0.1 * normal(random);
    const Se2 error(normal(random), normal(random), yaw);
    const Se2 T_map_i(1.0, 2.0, 0.7);
    const Eigen::Vector3d r =
        MotionResidual(motion)
            .At(T_map_i, T_map_i * motion.T_begin_end * error, Eigen::Vector3d::Zero(), 0.0)
            .r;
    EXPECT_NEAR(r.z(), yaw / std::sqrt(motion.cov(2, 2)), 1e-4 * std::abs(r.z()) + 1e-9);
  }
}

}  // namespace
}  // namespace shiftmap
