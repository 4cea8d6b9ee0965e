// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/ceres_posterior.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <memory>
#include <random>
#include <utility>
#include <vector>

#include "tests/support/circle_graph.h"

namespace shiftmap {
namespace {

using testing::MakeCircleGraph;
using testing::MakeModesPrior;

// Solved graphs of all kinds: with a prior and with a pose that is held, of one run and of several.
std::vector<Graph> SolvedGraphs() {
  std::vector<Graph> graphs;
  graphs.push_back(MakeCircleGraph({.runs = 1, .frames = 80, .modes = 4}, 13));
  graphs.push_back(MakeCircleGraph({.runs = 3, .frames = 110, .modes = 6}, 17));
  graphs.back().anchor_run = 1;
  graphs.back().runs[0].variance_factor = 4.0;
  graphs.push_back(MakeCircleGraph({.runs = 2, .frames = 70, .modes = 6}, 5));
  graphs.back().priors = {MakeModesPrior(graphs.back())};
  for (Graph& graph : graphs) {
    graph.loss_reach = 50.0;
    SolveGraph({50}, &graph);
  }
  return graphs;
}

struct Posteriors {
  std::unique_ptr<GraphPosterior> schur;
  std::unique_ptr<GraphPosterior> ceres;
};

Posteriors PosteriorsOf(Graph* graph) {
  Posteriors posteriors;
  graph->solver = SolverKind::kSchur;
  posteriors.schur = LinearizeGraph(*graph);
  graph->solver = SolverKind::kCeres;
  posteriors.ceres = LinearizeGraph(*graph);
  return posteriors;
}

void ExpectSame(const Eigen::MatrixXd& schur, const Eigen::MatrixXd& ceres) {
  ASSERT_EQ(schur.rows(), ceres.rows());
  ASSERT_EQ(schur.cols(), ceres.cols());
  EXPECT_GT(schur.norm(), 0.0);
  EXPECT_LT((schur - ceres).norm(), 1e-6 * schur.norm());
}

TEST(CeresPosterior, SaysWhatTheEliminationSays) {
  for (Graph& graph : SolvedGraphs()) {
    const auto [schur, ceres] = PosteriorsOf(&graph);
    ASSERT_TRUE(schur && ceres);
    const Eigen::Index modes = 2 * graph.modes.end_index();
    const Eigen::Index calibrations = kRunCalibration * graph.runs.end_index();
    ExpectSame(schur->ModeCovariance(), ceres->ModeCovariance());
    const Eigen::MatrixXd weights = Eigen::MatrixXd::Identity(modes, 3);
    ExpectSame(schur->ModeCovarianceTimes(weights), ceres->ModeCovarianceTimes(weights));
    ExpectSame(schur->ModeDifferenceCovariance(1, 3), ceres->ModeDifferenceCovariance(1, 3));
    const Eigen::MatrixXd of_runs = Eigen::MatrixXd::Identity(calibrations, 4);
    ExpectSame(schur->CalibrationInformationTimes(of_runs),
               ceres->CalibrationInformationTimes(of_runs));
  }
}

TEST(CeresPosterior, DrawsTheSameNoise) {
  for (Graph& graph : SolvedGraphs()) {
    const auto [schur, ceres] = PosteriorsOf(&graph);
    ASSERT_TRUE(schur && ceres);
    std::mt19937_64 of_schur(3);
    std::mt19937_64 of_ceres(3);
    const auto one = schur->DrawFitResiduals(5, of_schur);
    const auto other = ceres->DrawFitResiduals(5, of_ceres);
    ASSERT_EQ(one.size(), other.size());
    for (std::size_t draw = 0; draw < one.size(); ++draw) {
      for (const RunIndex r : graph.runs.indices()) {
        ExpectSame(one[draw].motions[r], other[draw].motions[r]);
      }
      ExpectSame(one[draw].observations, other[draw].observations);
    }
  }
}

TEST(CeresPosterior, MovesModesAlikeByTheResidualsOfBlocks) {
  for (Graph& graph : SolvedGraphs()) {
    const auto [schur, ceres] = PosteriorsOf(&graph);
    ASSERT_TRUE(schur && ceres);
    FrameBlocks blocks;
    for (const GraphRun& run : graph.runs) {
      auto& of_run = blocks.emplace_back();
      for (std::size_t i = 0; i < run.poses.size(); ++i) {
        of_run.push_back(static_cast<int>(3 * i / run.poses.size()));
      }
    }
    const GraphResiduals residuals = PresentResiduals(graph);
    ExpectSame(schur->ModeStepsByBlock(residuals, blocks, 3),
               ceres->ModeStepsByBlock(residuals, blocks, 3));
  }
}

TEST(CeresPosterior, FitsErrorsAlike) {
  for (Graph& graph : SolvedGraphs()) {
    const auto [schur, ceres] = PosteriorsOf(&graph);
    ASSERT_TRUE(schur && ceres);
    // One amplitude of all runs, and one of each.
    LinearErrors errors;
    errors.amplitudes = 1 + std::ssize(graph.runs);
    for (const RunIndex r : graph.runs.indices()) errors.of_run.push_back({0, 1 + r.value()});
    const GraphResiduals present = PresentResiduals(graph);
    errors.of_observation = [&](ObservationIndex i) {
      Eigen::Matrix2Xd E(2, 2);
      E << present.observations.col(i.value()), Eigen::Vector2d(1.0, std::sin(0.1 * i.value()));
      return E;
    };
    const GraphPosterior::ErrorFit one = schur->FitErrors(errors);
    const GraphPosterior::ErrorFit other = ceres->FitErrors(errors);
    ExpectSame(one.mode_steps, other.mode_steps);
    ExpectSame(one.information, other.information);

    graph.threads = 3;
    graph.solver = SolverKind::kSchur;
    const GraphPosterior::ErrorFit threaded = LinearizeGraph(graph)->FitErrors(errors);
    EXPECT_EQ(threaded.mode_steps, one.mode_steps);
    EXPECT_EQ(threaded.information, one.information);
  }
}

// Blocks in the lists that it was given, each once.
TEST(CeresPosterior, VisitsTheBlocksOfTheCovariance) {
  Graph graph = SolvedGraphs().back();
  graph.solver = SolverKind::kCeres;
  const auto posterior = LinearizeGraph(graph, {{0, 2, 3}, {1, 4, 5}});
  ASSERT_TRUE(posterior);
  const Eigen::MatrixXd covariance = posterior->ModeCovariance();
  int visited = 0;
  posterior->VisitModeCovariance([&](ModeIndex a, ModeIndex b, const Eigen::Matrix2d& cov_a_b) {
    ++visited;
    const Eigen::Matrix2d wanted = covariance.block<2, 2>(2 * a, 2 * b);
    EXPECT_LT((cov_a_b - wanted).norm(), 1e-9 * covariance.diagonal().maxCoeff());
  });
  EXPECT_EQ(visited, 2 * 6);
}

TEST(CeresPosterior, DrawsOfModesHaveTheCovariance) {
  Graph graph = SolvedGraphs().back();
  graph.solver = SolverKind::kCeres;
  const auto posterior = LinearizeGraph(graph);
  ASSERT_TRUE(posterior);
  constexpr int kDraws = 4000;
  std::mt19937_64 random(1);
  const Eigen::MatrixXd draws = posterior->DrawModes(kDraws, random);
  const Eigen::MatrixXd covariance = posterior->ModeCovariance();
  // Six standard deviations of a variance's estimate.
  EXPECT_LT((draws * draws.transpose() / kDraws - covariance).cwiseAbs().maxCoeff(),
            6.0 * std::sqrt(2.0 / kDraws) * covariance.diagonal().maxCoeff());
}

TEST(CeresPosterior, IsNoneOfModesThatNothingDetermines) {
  Graph graph = MakeCircleGraph({.runs = 1, .frames = 110, .modes = 6}, 13);
  graph.solver = SolverKind::kCeres;
  EXPECT_TRUE(LinearizeGraph(graph));
  graph.modes.emplace_back(1.0, 2.0);
  EXPECT_FALSE(LinearizeGraph(graph));
}

TEST(CeresPosterior, IsNoneOfValuesThatAreNotFinite) {
  Graph graph = MakeCircleGraph({.runs = 1, .frames = 80, .modes = 4}, 13);
  graph.solver = SolverKind::kCeres;
  graph.modes[1].x() = std::nan("");
  EXPECT_FALSE(LinearizeGraph(graph));
  EXPECT_FALSE(SolveGraph({50}, &graph).converged);
}

}  // namespace
}  // namespace shiftmap
