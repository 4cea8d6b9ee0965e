// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/incremental/observation_sequence.h"

#include <gtest/gtest.h>

#include <cmath>

#include "mapper/selection/viterbi.h"
#include "tests/support/geometry_matchers.h"

namespace shiftmap {
namespace {

using testing::IsNearMatrix;

TEST(MakeObservationSequence, SeenAndMissedStepsAreThoseOfThePaper) {
  const Eigen::Vector2d detection(0.6, 0.1);
  const Eigen::Vector2d log_density(-1.0, -3.0);
  const ModeSequenceProblem problem = MakeObservationSequence(
      Eigen::Vector2d(0.7, 0.3), 1e-4, {{detection, log_density}, {detection, std::nullopt}});
  EXPECT_NEAR(problem.log_likelihood(0, 0), std::log(0.6) - 1.0, 1e-12);
  EXPECT_NEAR(problem.log_likelihood(0, 1), std::log(0.1) - 3.0, 1e-12);
  EXPECT_NEAR(problem.log_likelihood(1, 0), std::log(0.4), 1e-12);
  EXPECT_NEAR(problem.log_likelihood(1, 1), std::log(0.9), 1e-12);
  EXPECT_EQ(problem.missed, (std::vector<bool>{false, true}));
  EXPECT_NEAR(std::exp(problem.log_initial[0]), 0.7, 1e-12);
}

TEST(MakeObservationSequence, TheChangeProbabilityIsSpreadOverTheOtherStates) {
  const Eigen::VectorXd initial = Eigen::Vector4d::Constant(0.25);
  const ObservationStep step{Eigen::Vector4d::Constant(0.5), std::nullopt};
  const ModeSequenceProblem problem = MakeObservationSequence(initial, 0.03, {step, step});
  const Eigen::MatrixXd transition = problem.log_transition[0].array().exp();
  EXPECT_NEAR(transition(1, 1), 0.97, 1e-12);
  EXPECT_NEAR(transition(1, 2), 0.01, 1e-12);
  EXPECT_THAT(transition.rowwise().sum().eval(), IsNearMatrix(Eigen::VectorXd::Ones(4), 1e-12));
}

// Unseen for a while, then where it was: without the transition term of missed steps, going away
// and coming back behind the sensor's back would be free and likelier.
TEST(MakeObservationSequence, AMissedStepPaysForItsTransition) {
  const Eigen::Vector2d detection(0.5, 0.01);
  const ObservationStep seen{detection, Eigen::Vector2d(0.0, -20.0)};
  const ObservationStep missed{detection, std::nullopt};
  const ModeSequenceProblem problem =
      MakeObservationSequence(Eigen::Vector2d(0.5, 0.5), 1e-4, {seen, missed, missed, seen});
  EXPECT_EQ(MostLikelyModes(problem), (std::vector<int>{0, 0, 0, 0}));
  // Step 1 to 2 pays like any other.
  EXPECT_NEAR(LogJoint(problem, {0, 0, 1, 0}) - LogJoint(problem, {0, 0, 0, 0}),
              2.0 * std::log(1e-4 / (1.0 - 1e-4)) + std::log(0.99 / 0.5),
              1e-9);
  // Missed often enough, it has left.
  std::vector<ObservationStep> often(20, missed);
  often.front() = seen;
  EXPECT_EQ(MostLikelyModes(MakeObservationSequence(Eigen::Vector2d(0.5, 0.5), 1e-4, often)).back(),
            1);
}

TEST(MakeObservationSequence, ASingleStateStays) {
  const ObservationStep step{Eigen::VectorXd::Constant(1, 0.5), Eigen::VectorXd::Zero(1)};
  const ModeSequenceProblem problem =
      MakeObservationSequence(Eigen::VectorXd::Ones(1), 1e-4, {step, step});
  EXPECT_EQ(MostLikelyModes(problem), (std::vector<int>{0, 0}));
  EXPECT_EQ(problem.log_transition[0](0, 0), 0.0);
}

}  // namespace
}  // namespace shiftmap
