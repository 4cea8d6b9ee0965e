// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/ceres_costs.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <random>
#include <vector>

#include "tests/support/geometry_matchers.h"
#include "tests/support/random_map.h"

namespace shiftmap {
namespace {

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

Eigen::VectorXd Residual(const ceres::CostFunction& cost,
                         const std::vector<Eigen::VectorXd>& blocks) {
  std::vector<const double*> parameters;
  for (const Eigen::VectorXd& block : blocks) parameters.push_back(block.data());
  Eigen::VectorXd residual(cost.num_residuals());
  EXPECT_TRUE(cost.Evaluate(parameters.data(), residual.data(), nullptr));
  return residual;
}

void ExpectJacobiansAreDerivatives(const ceres::CostFunction& cost,
                                   std::vector<Eigen::VectorXd> blocks) {
  constexpr double kStep = 1e-6;
  std::vector<const double*> parameters;
  std::vector<RowMajor> jacobians;
  std::vector<double*> outputs;
  for (const Eigen::VectorXd& block : blocks) {
    parameters.push_back(block.data());
    jacobians.emplace_back(cost.num_residuals(), block.size());
  }
  for (RowMajor& jacobian : jacobians) outputs.push_back(jacobian.data());
  Eigen::VectorXd residual(cost.num_residuals());
  ASSERT_TRUE(cost.Evaluate(parameters.data(), residual.data(), outputs.data()));
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    for (Eigen::Index column = 0; column < blocks[b].size(); ++column) {
      double& value = blocks[b][column];
      const double at = value;
      value = at + kStep;
      const Eigen::VectorXd above = Residual(cost, blocks);
      value = at - kStep;
      const Eigen::VectorXd below = Residual(cost, blocks);
      value = at;
      const Eigen::VectorXd numeric = (above - below) / (2.0 * kStep);
      const double tolerance = 1e-6 * (1.0 + numeric.cwiseAbs().maxCoeff());
      EXPECT_THAT(jacobians[b].col(column), testing::IsNearMatrix(numeric, tolerance))
          << "block " << b << " column " << column;
    }
  }
}

class CostFunctions : public ::testing::Test {
 protected:
  Eigen::VectorXd Normal(Eigen::Index size, double sd) {
    Eigen::VectorXd values(size);
    for (double& value : values) value = sd * normal_(random_);
    return values;
  }

  Eigen::VectorXd PoseBlock(const Se2& pose) {
    return Eigen::Vector3d(pose.x(), pose.y(), pose.yaw());
  }

  std::mt19937_64 random_{testing::TestSeed(31)};
  std::normal_distribution<double> normal_;
};

TEST_F(CostFunctions, MotionJacobians) {
  for (int trial = 0; trial < 30; ++trial) {
    MotionIncrement motion;
    AppendMotion(1.0 + normal_(random_),
                 0.5 * normal_(random_),
                 FromSeconds(1.0),
                 OdometryCalibration(),
                 &motion);
    motion.J_calibration.col(2) = Normal(3, 0.3);
    const Se2 T_map_i = Se2::Exp(Normal(3, 2.0));
    const Se2 T_map_j = T_map_i * motion.T_begin_end * Se2::Exp(Normal(3, 0.2));
    const MotionCost cost(motion, 4.0);
    ExpectJacobiansAreDerivatives(
        cost, {PoseBlock(T_map_i), PoseBlock(T_map_j), Normal(3, 0.1), Normal(3, 0.05)});
  }
}

TEST_F(CostFunctions, MotionResidualIsTheWhitenedCorrectedError) {
  MotionIncrement motion;
  AppendMotion(1.2, 0.4, FromSeconds(2.0), OdometryCalibration(), &motion);
  const Eigen::Vector3d correction(0.03, -0.02, 0.0);
  const Eigen::Vector3d error(0.05, -0.02, 0.03);
  const Se2 T_map_i(1.0, -2.0, 0.7);
  const Se2 T_map_j =
      T_map_i * motion.T_begin_end * Se2::Exp(motion.J_calibration * correction) * Se2::Exp(error);
  const Eigen::VectorXd residual =
      Residual(MotionCost(motion, 4.0),
               {PoseBlock(T_map_i), PoseBlock(T_map_j), correction, Eigen::Vector3d::Zero()});
  const Eigen::Matrix3d cov = motion.cov + 1e-8 * Eigen::Matrix3d::Identity();
  EXPECT_NEAR(residual.squaredNorm(), error.dot(cov.inverse() * error) / 4.0, 1e-9);
}

TEST_F(CostFunctions, ObservationJacobians) {
  for (const Observation::Kind kind :
       {Observation::Kind::kRangeBearing, Observation::Kind::kCartesian}) {
    for (int trial = 0; trial < 30; ++trial) {
      const Se2 T_map_vehicle = Se2::Exp(Normal(3, 1.0));
      const Eigen::Vector2d q(4.0 + normal_(random_), normal_(random_));
      GraphObservation item;
      item.observation.kind = kind;
      item.observation.z = kind == Observation::Kind::kCartesian
                               ? q
                               : Eigen::Vector2d(q.norm(), std::atan2(q.y(), q.x()));
      item.observation.z += Normal(2, 0.1);
      item.cov_z = testing::RandomCovariance(random_, 0.01);
      item.mean_squared_bearing = 0.15;
      const ObservationCost cost(item);
      ExpectJacobiansAreDerivatives(cost,
                                    {PoseBlock(T_map_vehicle), T_map_vehicle * q, Normal(3, 0.05)});
    }
  }
}

}  // namespace
}  // namespace shiftmap
