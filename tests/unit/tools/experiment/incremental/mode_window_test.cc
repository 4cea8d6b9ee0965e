// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/incremental/mode_window.h"

#include <gtest/gtest.h>

#include <cmath>

namespace shiftmap {
namespace {

IncrementalOptions Options() {
  IncrementalOptions options;
  options.sensor.sd_range_m = 0.1;
  options.sensor.sd_bearing_rad = 0.02;
  options.sensor.max_range_m = 6.0;
  options.sensor.max_bearing_rad = 0.5;
  options.sensor.detection_probability = 0.6;
  options.change_probability = 1e-3;
  return options;
}

// A vehicle that stands at the origin and looks along x; two modes in view, one behind it.
Window StandingWindow(int frames) {
  Window window;
  for (const Eigen::Vector2d& place :
       {Eigen::Vector2d(3.0, 0.0), Eigen::Vector2d(4.0, 0.5), Eigen::Vector2d(-3.0, 0.0)}) {
    window.modes.push_back({place, place, place, Eigen::Matrix2d::Identity(), false});
  }
  window.frames.resize(static_cast<std::size_t>(frames));
  return window;
}

void See(int frame, int group, int mode, double range_m, Window* window) {
  WindowObservation seen;
  seen.group = group;
  seen.mode = mode;
  seen.factor.observation.z = {range_m, 0.0};
  seen.factor.cov_z = Eigen::Vector2d(0.01, 0.0004).asDiagonal();
  window->frames[static_cast<std::size_t>(frame)].observations.push_back(seen);
}

TEST(ModeWindowTest, HasAStepPerFrameInWhichTheGroupIsSeenOrMissed) {
  Window window = StandingWindow(5);
  See(0, 1, 2, 1.0, &window);  // Another landmark.
  See(1, 0, 0, 3.0, &window);
  See(3, 0, kNoMode, 9.0, &window);  // Clutter so far: no step.
  See(4, 0, 1, 4.0, &window);
  const ModeWindow chain = MakeModeWindow(window, 0, {{0, 1}, 1, 0}, Options());
  ASSERT_EQ(chain.problem.steps(), 4);
  ASSERT_EQ(chain.sightings.size(), 4u);
  EXPECT_EQ(chain.sightings[0].frame, -1);
  EXPECT_EQ(chain.sightings[1].frame, 1);
  EXPECT_EQ(chain.sightings[2].frame, -1);
  EXPECT_EQ(chain.sightings[3].frame, 4);
  EXPECT_TRUE(chain.problem.IsMissed(0));
  EXPECT_FALSE(chain.problem.IsMissed(1));
}

TEST(ModeWindowTest, WhatIsOutOfViewIsNotMissed) {
  Window window = StandingWindow(3);
  See(1, 0, 2, 3.0, &window);
  const ModeWindow chain = MakeModeWindow(window, 0, {{2}, 1, 0}, Options());
  EXPECT_EQ(chain.problem.steps(), 1);
}

TEST(ModeWindowTest, WeighsDetectionsAsPrinted) {
  Window window = StandingWindow(1);
  See(0, 0, 0, 3.1, &window);
  const ModeWindow chain = MakeModeWindow(window, 0, {{0, 1}, 1, 0}, Options());
  // Well in view: P_D N(ν; 0, R) of the first mode, at a standard deviation in range.
  const double log_density = -0.5 - std::log(2.0 * M_PI * 0.1 * 0.02);
  EXPECT_NEAR(chain.problem.log_likelihood(0, 0), std::log(0.6) + log_density, 1e-3);
  EXPECT_LT(chain.problem.log_likelihood(0, 1), chain.problem.log_likelihood(0, 0) - 10.0);
}

TEST(ModeWindowTest, StartsFromTheChoiceBeforeTheWindow) {
  Window window = StandingWindow(1);
  See(0, 0, 0, 3.0, &window);
  IncrementalOptions options = Options();
  IncrementalGroup group{{0, 1, 2}, 1, 1};
  Eigen::VectorXd initial =
      MakeModeWindow(window, 0, group, options).problem.log_initial.array().exp();
  EXPECT_NEAR(initial[0], 5e-4, 1e-12);
  EXPECT_NEAR(initial[1], 0.999, 1e-12);
  group.choice_before = kNoMode;
  initial = MakeModeWindow(window, 0, group, options).problem.log_initial.array().exp();
  EXPECT_NEAR(initial[1], 1.0 / 3.0, 1e-12);
  // The weights of the mixture are not the chain's.
  group.choice_before = 1;
  options.selector.kind = SelectorKind::kMaxMixture;
  initial = MakeModeWindow(window, 0, group, options).problem.log_initial.array().exp();
  EXPECT_NEAR(initial[1], 1.0 / 3.0, 1e-12);
}

}  // namespace
}  // namespace shiftmap
