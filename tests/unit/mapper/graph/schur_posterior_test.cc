// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/schur_posterior.h"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <cmath>
#include <memory>
#include <random>

#include "tests/support/circle_graph.h"

namespace shiftmap {
namespace {

using testing::MakeCircleGraph;
using testing::MakeModesPrior;

std::unique_ptr<SchurPosterior> PosteriorOf(const Graph& graph) {
  std::unique_ptr<ReducedSystem> reduced;
  return SchurPosterior::Of(graph, {}, &reduced);
}

TEST(SchurPosterior, SamplesHaveTheCovariance) {
  Graph graph = MakeCircleGraph({.runs = 1, .frames = 80, .modes = 4}, 13);
  graph.priors = {MakeModesPrior(graph)};
  SolveGraph({30}, &graph);
  const std::unique_ptr<SchurPosterior> posterior = PosteriorOf(graph);
  ASSERT_TRUE(posterior);
  const Eigen::MatrixXd covariance = posterior->ModeCovariance();
  std::mt19937_64 random(1);
  constexpr int kSamples = 4000;
  Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(covariance.rows(), covariance.cols());
  for (const ResidualSample& sample : posterior->SampleResiduals(kSamples, random)) {
    sum += sample.step.modes * sample.step.modes.transpose() / kSamples;
  }
  // Six standard deviations of a variance's estimate.
  EXPECT_LT((sum - covariance).cwiseAbs().maxCoeff(),
            6.0 * std::sqrt(2.0 / kSamples) * covariance.diagonal().maxCoeff());
}

TEST(SchurPosterior, DifferencesOfModesHaveTheJointCovariances) {
  Graph graph = MakeCircleGraph({.runs = 2, .frames = 80, .modes = 6}, 17);
  graph.priors = {MakeModesPrior(graph)};
  const std::unique_ptr<SchurPosterior> posterior = PosteriorOf(graph);
  ASSERT_TRUE(posterior);
  const Eigen::MatrixXd covariance = posterior->ModeCovariance();
  for (ModeIndex a; a < 6; ++a) {
    for (ModeIndex b = a + 1; b < 6; ++b) {
      const Eigen::Matrix2d wanted =
          covariance.block<2, 2>(2 * a, 2 * a) + covariance.block<2, 2>(2 * b, 2 * b) -
          covariance.block<2, 2>(2 * a, 2 * b) - covariance.block<2, 2>(2 * b, 2 * a);
      EXPECT_LT((posterior->ModeDifferenceCovariance(a, b) - wanted).norm(), 1e-9 * wanted.norm());
    }
  }
}

}  // namespace
}  // namespace shiftmap
