// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/robust_loss.h"

#include <gtest/gtest.h>

#include <cmath>

namespace shiftmap {
namespace {

// The mean of f(‖r‖²) over Gaussian residuals of two rows: ‖r‖² has the density e^(-t/2) / 2.
template <typename Function>
double GaussianMean(const Function& f) {
  constexpr double kStep = 1e-3;
  double sum = 0.0;
  for (double t = 0.5 * kStep; t < 80.0; t += kStep) sum += f(t) * 0.5 * std::exp(-0.5 * t) * kStep;
  return sum;
}

TEST(RobustLoss, CurvatureOfGaussianResidualsIsTheVarianceOfTheirSlope) {
  for (const double scale : {1.5, 2.5, 5.0, 20.0, 100.0}) {
    const RobustLoss loss(scale);
    const double curvature = GaussianMean([&](double t) { return loss.Curvature(t); });
    const double variance =
        GaussianMean([&](double t) { return 0.5 * t * loss.Slope(t) * loss.Slope(t); });
    EXPECT_NEAR(curvature, variance, 1e-5) << scale;
    EXPECT_LT(curvature, 1.0) << scale;  // No loss tells more than the square does.
  }
}

TEST(RobustLoss, SlopeAndCurvatureAreItsDerivatives) {
  const RobustLoss loss(2.5);
  constexpr double kStep = 1e-4;
  for (const double x : {0.1, 1.0, 2.5, 6.0}) {
    for (const double y : {0.0, 0.7, 3.0}) {
      const auto half_loss = [&](double dx, double dy) {
        return loss.HalfLoss((x + dx) * (x + dx) + (y + dy) * (y + dy));
      };
      const double squared = x * x + y * y;
      const double slope = (half_loss(kStep, 0.0) - half_loss(-kStep, 0.0)) / (2.0 * kStep);
      EXPECT_NEAR(slope, loss.Slope(squared) * x, 1e-6);
      const double laplacian =
          (half_loss(kStep, 0.0) + half_loss(-kStep, 0.0) + half_loss(0.0, kStep) +
           half_loss(0.0, -kStep) - 4.0 * half_loss(0.0, 0.0)) /
          (kStep * kStep);
      EXPECT_NEAR(0.5 * laplacian, loss.Curvature(squared), 1e-5);
    }
  }
}

TEST(RobustLoss, NoStepByItsStepCurvatureGoesUp) {
  const RobustLoss loss(2.5);
  for (double x = 0.01; x < 300.0; x *= 1.1) {
    const double squared = x * x;
    const double next = x - loss.Slope(squared) * x / loss.StepCurvature(squared);
    EXPECT_LT(loss.HalfLoss(next * next), loss.HalfLoss(squared)) << x;
  }
  const double step = GaussianMean([&](double t) { return loss.StepCurvature(t); });
  EXPECT_NEAR(step, GaussianMean([&](double t) { return loss.Curvature(t); }), 0.03);
}

TEST(RobustLoss, AVarianceFactorDividesItAndMovesNoLimit) {
  const RobustLoss loss(2.5, 50.0, 4.0);
  const RobustLoss whole(2.5, 50.0);
  for (const double squared : {0.1, 5.0, 2400.0, 2600.0}) {
    EXPECT_DOUBLE_EQ(4.0 * loss.HalfLoss(squared), whole.HalfLoss(squared));
    EXPECT_DOUBLE_EQ(4.0 * loss.Slope(squared), whole.Slope(squared));
    EXPECT_DOUBLE_EQ(4.0 * loss.Curvature(squared), whole.Curvature(squared));
  }
}

TEST(RobustLoss, FarOutliersStillHaveCurvature) {
  const RobustLoss loss(2.5);
  EXPECT_GT(loss.Curvature(1e6), 1e-7);
  EXPECT_LT(loss.Curvature(1e6), loss.Curvature(100.0));
}

TEST(RobustLoss, IsConstantBeyondItsReach) {
  const RobustLoss loss(2.5, 50.0);
  const RobustLoss endless(2.5);
  const double within = 49.9 * 49.9;
  const double beyond = 50.1 * 50.1;
  EXPECT_EQ(loss.HalfLoss(within), endless.HalfLoss(within));
  EXPECT_EQ(loss.Slope(within), endless.Slope(within));
  EXPECT_EQ(loss.HalfLoss(beyond), loss.HalfLoss(2500.0));
  EXPECT_EQ(loss.HalfLoss(1e8), loss.HalfLoss(2500.0));
  EXPECT_EQ(loss.Slope(beyond), 0.0);
  EXPECT_EQ(loss.Weight(beyond), endless.Weight(beyond));
}

// That each pulls at the scale with κ c², however far it is, is why there is a reach.
TEST(RobustLoss, WithoutReachOutliersPullAtTheScaleHoweverFarTheyAre) {
  const RobustLoss loss(2.5);
  const double pull = loss.Weight(0.0) * 2.5 * 2.5;
  for (const double length : {1e3, 1e4, 1e5}) {
    EXPECT_NEAR(loss.Slope(length * length) * length * length, pull, 1e-4 * pull);
  }
}

TEST(RobustLoss, IsTheSquareForSmallResiduals) {
  const RobustLoss loss(1e4);
  EXPECT_NEAR(loss.HalfLoss(4.0), 2.0, 1e-6);
  EXPECT_NEAR(loss.Weight(4.0), 1.0, 1e-6);
}

}  // namespace
}  // namespace shiftmap
