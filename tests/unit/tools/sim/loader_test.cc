// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/loader.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "tests/support/geometry_matchers.h"
#include "tests/support/status_matchers.h"

namespace shiftmap {
namespace {

using testing::IsNearPose;
using testing::StatusIs;

constexpr double kTickS = 0.05;

Se2 Moved(const Se2& pose, const Velocity& velocity, double seconds) {
  return pose * Se2::Exp({velocity.v_mps * seconds, 0.0, velocity.omega_radps * seconds});
}

// Drives until speed and articulation are those of the command.
void Settle(const LoaderCommand& command, Loader* loader) {
  for (int i = 0; i < 400; ++i) loader->Step(command, kTickS);
}

TEST(Loader, DrivesACircleAtConstantArticulation) {
  const LoaderOptions options;
  for (const double articulation : {0.3, -0.5, 0.7}) {
    for (const double v : {2.0, -1.5}) {
      const LoaderCommand command{v, articulation};
      Loader loader(options);
      Settle(command, &loader);
      ASSERT_DOUBLE_EQ(loader.articulation_rad(), articulation);
      const double radius =
          (options.front_m * std::cos(articulation) + options.rear_m) / std::sin(articulation);
      Se2 pose;
      double angle = 0.0;
      for (int i = 0; i < 200; ++i) {
        pose = Moved(pose, loader.Step(command, kTickS), kTickS);
        angle += v * kTickS / radius;
        // The centre of the circle is on the axle, to the left at a positive articulation.
        const Se2 expected(radius * std::sin(angle), radius * (1.0 - std::cos(angle)), angle);
        ASSERT_THAT(pose, IsNearPose(expected, 1e-9));
      }
    }
  }
}

// What makes the formula: the rear axle does not slip sideways either, also while γ changes.
TEST(Loader, TheRearAxleRollsWhereItPoints) {
  const LoaderOptions options;
  constexpr double kStepS = 1e-4;
  Loader loader(options);
  Settle({1.0, -0.6}, &loader);
  const auto rear_axle = [&](const Se2& front, double articulation) {
    const Se2 hinge = front * Se2(-options.front_m, 0.0, 0.0);
    return hinge * Se2(0.0, 0.0, -articulation) * Se2(-options.rear_m, 0.0, 0.0);
  };
  Se2 front(3.0, -2.0, 0.7);
  Se2 rear = rear_axle(front, loader.articulation_rad());
  for (int i = 0; i < 30000; ++i) {
    front = Moved(front, loader.Step({1.0, 0.6}, kStepS), kStepS);
    const Se2 next = rear_axle(front, loader.articulation_rad());
    const Eigen::Vector3d twist = (rear.Inverse() * next).Log() / kStepS;
    ASSERT_NEAR(twist.y(), 0.0, 1e-6) << "m/s sideways, step " << i;
    rear = next;
  }
  EXPECT_NEAR(loader.articulation_rad(), 0.45, 1e-9) << "0.35 rad/s for 3 s";
}

TEST(Loader, KeepsItsLimits) {
  const LoaderOptions options;
  Loader loader(options);
  double v = 0.0;
  double articulation = 0.0;
  for (int i = 0; i < 200; ++i) {
    loader.Step({5.0, 3.0}, kTickS);
    EXPECT_LE(loader.v_mps() - v, options.acceleration_mps2 * kTickS + 1e-12);
    EXPECT_LE(loader.articulation_rad() - articulation,
              options.max_articulation_radps * kTickS + 1e-12);
    v = loader.v_mps();
    articulation = loader.articulation_rad();
  }
  EXPECT_DOUBLE_EQ(v, 5.0);
  EXPECT_DOUBLE_EQ(articulation, options.max_articulation_rad);
}

TEST(Loader, ArticulationForACurvatureDrivesIt) {
  LoaderOptions options;
  options.max_articulation_rad = 1.5;
  for (const double curvature : {0.0, 0.05, -0.2, 0.3}) {
    const double articulation = Loader::ArticulationFor(options, curvature);
    EXPECT_NEAR(Loader::YawRate(options, 1.0, articulation, 0.0), curvature, 1e-12);
  }
  EXPECT_DOUBLE_EQ(Loader::ArticulationFor(LoaderOptions(), -10.0),
                   -LoaderOptions().max_articulation_rad);
}

TEST(Loader, RefusesOptionsOutOfRange) {
  LoaderOptions options;
  options.max_articulation_rad = std::numbers::pi;
  EXPECT_THAT(options.Validate(), StatusIs(StatusCode::kInvalidArgument, "articulation"));
  options = {};
  options.rear_m = 0.0;
  EXPECT_THAT(options.Validate(), StatusIs(StatusCode::kInvalidArgument, "rear axle = 0"));
}

}  // namespace
}  // namespace shiftmap
