// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <Eigen/QR>
#include <cmath>
#include <memory>
#include <random>

#include "localizer/models/observation_model.h"
#include "mapper/graph/graph.h"
#include "mapper/graph/graph_posterior.h"
#include "mapstore/geometry/angle.h"
#include "tests/support/geometry_matchers.h"
#include "tests/support/random_map.h"

namespace shiftmap {
namespace {

constexpr double kMotionVarianceFloor = 1e-8;  // That of the motion residual, per axis.
constexpr double kNoLoss = 1e6;                // A loss scale that leaves every residual squared.

struct GraphShape {
  int poses = 8;
  int modes = 4;
  double noise_v = 0.05;
  double noise_omega = 0.05;
  Eigen::Vector2d sd_z{0.1, 0.02};
};

// A vehicle on a winding path sees every mode from every pose; noise as the graph is told.
Graph RandomGraph(const GraphShape& shape, std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  Graph graph;
  graph.loss_scale = kNoLoss;
  for (int m = 0; m < shape.modes; ++m) {
    const double angle = 6.28 * m / shape.modes;
    graph.modes.emplace_back(12.0 * std::cos(angle) + normal(random),
                             12.0 * std::sin(angle) + normal(random));
  }
  const OdometryCalibration odometry{.noise_v = shape.noise_v, .noise_omega = shape.noise_omega};
  GraphRun run;
  run.sensor_bias_sd = SensorBias(0.02, 0.05, 0.3);
  run.correction_prior_sd = Eigen::Vector3d(0.05, 0.05, 0.2);
  std::vector<Se2> truth = {Se2()};
  for (int i = 0; i < shape.poses; ++i) {
    if (i > 0) {
      MotionIncrement motion;
      AppendMotion(
          1.0 + 0.5 * std::sin(i), 0.6 * std::cos(0.3 * i), FromSeconds(1.0), odometry, &motion);
      motion.J_calibration.col(2) = Eigen::Vector3d(0.3 * std::cos(i), 0.0, 0.2 * std::sin(i));
      const Eigen::LLT<Eigen::Matrix3d> llt(motion.cov);
      const Eigen::Vector3d noise(normal(random), normal(random), normal(random));
      truth.push_back(truth.back() * motion.T_begin_end * Se2::Exp(llt.matrixL() * noise));
      run.motions.push_back(motion);
    }
    for (const ModeIndex m : graph.modes.indices()) {
      const Eigen::Vector2d q = truth.back().Inverse() * graph.modes[m];
      GraphObservation item;
      item.frame = FrameIndex(i);
      item.mode = m;
      item.cov_z = shape.sd_z.cwiseAbs2().asDiagonal();
      item.mean_squared_bearing = 1.0;
      item.observation.z = {q.norm() + shape.sd_z.x() * normal(random),
                            std::atan2(q.y(), q.x()) + shape.sd_z.y() * normal(random)};
      graph.observations.push_back(item);
    }
  }
  run.poses = truth;
  graph.runs.push_back(std::move(run));
  return graph;
}

// The graph's residuals with dense derivatives by central differences, written down once more from
// the formulas. Parameters: poses but the first, correction, bias, modes.
class DenseGraph {
 public:
  explicit DenseGraph(const Graph& graph) : graph_(graph) {
    const GraphRun& run = graph.runs.front();
    for (FrameIndex i = 1; i < run.poses.end_index(); ++i) {
      Append({run.poses[i].x(), run.poses[i].y(), run.poses[i].yaw()});
    }
    Append({run.correction.x(), run.correction.y(), run.correction.z()});
    Append({run.sensor_bias.x(), run.sensor_bias.y(), run.sensor_bias.z()});
    for (const Eigen::Vector2d& mode : graph.modes) Append({mode.x(), mode.y()});
  }

  Eigen::Index parameters() const { return x_.size(); }
  Eigen::Index measured() const {
    return static_cast<Eigen::Index>(3 * graph_.runs.front().motions.size() +
                                     2 * graph_.observations.size());
  }

  // Measured residuals first, then the priors'.
  Eigen::VectorXd Residuals(const Eigen::VectorXd& x) const {
    const GraphRun& run = graph_.runs.front();
    const auto poses = static_cast<Eigen::Index>(run.poses.size());
    const Eigen::Vector3d correction = x.segment<3>(3 * (poses - 1));
    const Eigen::Vector3d bias = x.segment<3>(3 * (poses - 1) + 3);
    const double scale = std::exp(bias[kLogRangeScale]);
    const auto pose = [&](Eigen::Index i) {
      if (i == 0) return run.poses.front();
      return Se2(x[3 * i - 3], x[3 * i - 2], x[3 * i - 1]);
    };
    Eigen::VectorXd r(measured() + kRunCalibration);
    Eigen::Index row = 0;
    for (Eigen::Index i = 0; i + 1 < poses; ++i, row += 3) {
      const MotionIncrement& motion = run.motions[FrameIndex(i)];
      const Se2 expected = motion.T_begin_end * Se2::Exp(motion.J_calibration * correction);
      const Eigen::Matrix3d cov = motion.cov + kMotionVarianceFloor * Eigen::Matrix3d::Identity();
      Eigen::Vector3d error = (expected.Inverse() * pose(i).Inverse() * pose(i + 1)).Log();
      error.head<2>() *= scale;
      r.segment<3>(row) = Whiten(cov, error);
    }
    for (const GraphObservation& item : graph_.observations) {
      const Eigen::Vector2d p = x.segment<2>(3 * (poses - 1) + kRunCalibration + 2 * item.mode);
      const Eigen::Vector2d q = pose(item.frame.value()).Inverse() * p;
      const double curvature = std::pow(item.observation.z.y(), 2) - item.mean_squared_bearing;
      const Eigen::Vector2d h(scale * q.norm() * (1.0 + bias[kRangeCurvature] * curvature),
                              std::atan2(q.y(), q.x()) + bias[kBearingOffset]);
      Eigen::Vector2d difference = item.observation.z - h;
      difference.y() = WrapAngle(difference.y());
      r.segment<2>(row) = Whiten(item.cov_z, difference);
      row += 2;
    }
    r.segment<3>(row) =
        (correction - run.correction_prior_mean).cwiseQuotient(run.correction_prior_sd);
    r.segment<3>(row + 3) = bias.cwiseQuotient(run.sensor_bias_sd);
    return r;
  }

  Eigen::MatrixXd Jacobian() const {
    constexpr double kStep = 1e-6;
    Eigen::MatrixXd J(measured() + kRunCalibration, parameters());
    for (Eigen::Index column = 0; column < parameters(); ++column) {
      const Eigen::VectorXd step = kStep * Eigen::VectorXd::Unit(parameters(), column);
      J.col(column) = (Residuals(x_ + step) - Residuals(x_ - step)) / (2.0 * kStep);
    }
    return J;
  }

  Eigen::VectorXd Residuals() const { return Residuals(x_); }

 private:
  static Eigen::VectorXd Whiten(const Eigen::MatrixXd& cov, const Eigen::VectorXd& value) {
    return Eigen::LLT<Eigen::MatrixXd>(cov).matrixL().solve(value);
  }

  void Append(std::initializer_list<double> values) {
    for (const double value : values) {
      x_.conservativeResize(x_.size() + 1);
      x_[x_.size() - 1] = value;
    }
  }

  const Graph& graph_;
  Eigen::VectorXd x_;
};

class Posterior : public ::testing::Test {
 protected:
  std::mt19937_64 random_{testing::TestSeed(61)};
};

// One certain pose, one uncertain motion, one landmark seen from both ends.
TEST_F(Posterior, TwoPosesHaveTheClosedFormSolution) {
  const Eigen::Vector3d motion_variance(0.04, 0.09, 1e-10);
  const Eigen::Matrix2d R = (Eigen::Matrix2d() << 0.02, 0.005, 0.005, 0.01).finished();
  Graph graph;
  graph.loss_scale = kNoLoss;
  graph.modes = {Eigen::Vector2d(2.5, 1.0)};
  GraphRun run;
  run.poses = {Se2(), Se2(1.0, 0.0, 0.0)};
  run.motions.resize(1);
  run.motions[0].T_begin_end = Se2(1.0, 0.0, 0.0);
  run.motions[0].cov = motion_variance.asDiagonal();
  run.sensor_bias_sd.setConstant(1e-6);
  graph.runs.push_back(run);
  const std::vector<Eigen::Vector2d> z = {{3.0, 1.0}, {2.2, 0.9}};
  for (int frame = 0; frame < 2; ++frame) {
    GraphObservation item;
    item.frame = FrameIndex(frame);
    item.observation.kind = Observation::Kind::kCartesian;
    item.observation.z = z[static_cast<std::size_t>(frame)];
    item.cov_z = R;
    graph.observations.push_back(item);
  }
  const GraphSummary summary = SolveGraph({50}, &graph);
  EXPECT_TRUE(summary.converged);
  EXPECT_LT(summary.final_cost, summary.initial_cost);

  // p from pose 0 is z0 with R, by way of pose 1 it is (1, 0) + z1 with R + Σ + σ²_yaw G Gᵀ.
  const Eigen::Vector2d lever(-z[1].y(), z[1].x());
  const double yaw_variance = motion_variance.z() + kMotionVarianceFloor;
  const Eigen::Matrix2d via = R + Eigen::Matrix2d(motion_variance.head<2>().asDiagonal()) +
                              kMotionVarianceFloor * Eigen::Matrix2d::Identity() +
                              yaw_variance * lever * lever.transpose();
  const Eigen::Matrix2d cov = (R.inverse() + via.inverse()).inverse();
  const Eigen::Vector2d p =
      cov * (R.inverse() * z[0] + via.inverse() * (Eigen::Vector2d(1.0, 0.0) + z[1]));
  EXPECT_THAT(graph.modes[0], testing::IsNearMatrix(p, 1e-4));
  EXPECT_THAT(LinearizeGraph(graph)->ModeCovariance(), testing::IsNearMatrix(cov, 1e-6));
}

TEST_F(Posterior, ModeCovarianceIsThatOfTheDenseProblem) {
  for (int trial = 0; trial < 5; ++trial) {
    Graph graph = RandomGraph({}, random_);
    ASSERT_TRUE(SolveGraph({100}, &graph).converged);
    const DenseGraph dense(graph);
    const Eigen::MatrixXd J = dense.Jacobian();
    const Eigen::MatrixXd cov = (J.transpose() * J).inverse();
    const Eigen::Index rows = 2 * graph.modes.end_index();
    const Eigen::MatrixXd expected = cov.bottomRightCorner(rows, rows);
    EXPECT_THAT(LinearizeGraph(graph)->ModeCovariance(),
                testing::IsNearMatrix(expected, 1e-5 * expected.cwiseAbs().maxCoeff()));
    // The gradient vanishes at what the solver calls the solution.
    const Eigen::VectorXd gradient = J.transpose() * dense.Residuals();
    EXPECT_LT(std::sqrt(gradient.dot(cov * gradient)), 0.05);
  }
}

TEST_F(Posterior, AVarianceFactorIsThatOfMotionsAndObservations) {
  constexpr double kFactor = 4.0;
  Graph graph = RandomGraph({}, random_);
  Graph noisier = graph;
  graph.runs.front().variance_factor = kFactor;
  for (MotionIncrement& motion : noisier.runs.front().motions) motion.cov *= kFactor;
  for (GraphObservation& item : noisier.observations) item.cov_z *= kFactor;
  ASSERT_TRUE(SolveGraph({100}, &graph).converged);
  ASSERT_TRUE(SolveGraph({100}, &noisier).converged);
  for (const ModeIndex m : graph.modes.indices()) {
    EXPECT_THAT(graph.modes[m], testing::IsNearMatrix(noisier.modes[m], 1e-4));
  }
  const Eigen::MatrixXd expected = LinearizeGraph(noisier)->ModeCovariance();
  EXPECT_THAT(LinearizeGraph(graph)->ModeCovariance(),
              testing::IsNearMatrix(expected, 1e-3 * expected.cwiseAbs().maxCoeff()));
}

ResidualStatistics StatisticsOf(const Graph& graph, int samples, std::uint64_t seed) {
  ResidualStatistics sum;
  const auto of_runs = ComputeRunStatistics(graph, samples, seed).value();
  for (const ResidualStatistics& run : of_runs) sum += run;
  return sum;
}

TEST_F(Posterior, RedundancyIsResidualsLessParameters) {
  constexpr int kSamples = 800;
  Graph graph = RandomGraph({}, random_);
  SolveGraph({100}, &graph);
  const DenseGraph dense(graph);
  const Eigen::MatrixXd J = dense.Jacobian();
  const Eigen::MatrixXd cov = (J.transpose() * J).inverse();
  const Eigen::MatrixXd J_measured = J.topRows(dense.measured());
  const double explained = (J_measured * cov * J_measured.transpose()).trace();
  const ResidualStatistics statistics = StatisticsOf(graph, kSamples, 7);
  // The trace of a projection of rank k, by signs, scatters by √(2 k / samples) at most.
  const double rank = static_cast<double>(dense.measured()) - explained;
  const double sd = std::sqrt(2.0 * rank / kSamples);
  EXPECT_NEAR(statistics.redundancy.sum(), rank, 4.0 * sd);
  // Five priors take less than five degrees of freedom off the count of parameters.
  const auto free = static_cast<double>(dense.measured() - dense.parameters());
  EXPECT_GT(statistics.redundancy.sum(), free - 4.0 * sd);
  EXPECT_LT(statistics.redundancy.sum(), free + 5.0 + 4.0 * sd);
  EXPECT_NEAR(statistics.sum_of_squares.sum(),
              dense.Residuals().head(dense.measured()).squaredNorm(),
              1e-6);
}

TEST_F(Posterior, TheRatioOfEveryKindIsOneWhenTheNoiseIsRight) {
  Graph graph = RandomGraph({.poses = 300, .modes = 5}, random_);
  SolveGraph({100}, &graph);
  const ResidualStatistics statistics = StatisticsOf(graph, 30, 7);
  for (const auto kind : {ResidualStatistics::kTranslation,
                          ResidualStatistics::kYaw,
                          ResidualStatistics::kRange,
                          ResidualStatistics::kBearing}) {
    EXPECT_GT(statistics.redundancy[kind], 100.0) << kind;
    const double ratio = statistics.sum_of_squares[kind] / statistics.redundancy[kind];
    EXPECT_NEAR(ratio, 1.0, 0.3) << kind;
  }
  EXPECT_EQ(statistics.redundancy[ResidualStatistics::kPosition], 0.0);
}

TEST_F(Posterior, TheRatioTellsWhichNoiseIsWrong) {
  Graph graph = RandomGraph({.poses = 300, .modes = 5}, random_);
  for (GraphObservation& item : graph.observations) item.cov_z(1, 1) *= 4.0;
  SolveGraph({100}, &graph);
  const ResidualStatistics statistics = StatisticsOf(graph, 30, 7);
  const auto ratio = [&](ResidualStatistics::Kind kind) {
    return statistics.sum_of_squares[kind] / statistics.redundancy[kind];
  };
  EXPECT_NEAR(ratio(ResidualStatistics::kBearing), 0.25, 0.1);
  EXPECT_NEAR(ratio(ResidualStatistics::kRange), 1.0, 0.3);
}

// Squared standardized residual of one observation at the graph's present values.
double SquaredResidual(const Graph& graph, const GraphObservation& observation) {
  const GraphRun& run = graph.runs[observation.run];
  const Innovation innovation = Linearize(
      observation.observation, run.poses[observation.frame], graph.modes[observation.mode]);
  return SquaredMahalanobis(innovation.nu, observation.cov_z);
}

TEST_F(Posterior, AMisreadSignatureDoesNotBendTheSolution) {
  Graph graph = RandomGraph({.poses = 30, .modes = 4}, random_);
  graph.loss_scale = Graph().loss_scale;
  const IndexedVector<ModeIndex, Eigen::Vector2d> truth = graph.modes;
  std::swap(graph.observations[20].mode, graph.observations[21].mode);
  SolveGraph({100}, &graph);
  for (const ModeIndex m : truth.indices()) {
    EXPECT_LT((graph.modes[m] - truth[m]).norm(), 0.5) << m.value();
  }
  EXPECT_GT(SquaredResidual(graph, graph.observations[20]), 100.0);
}

TEST_F(Posterior, SolvesToTheSameBits) {
  Graph first = RandomGraph({.poses = 40}, random_);
  Graph second = first;
  SolveGraph({100}, &first);
  SolveGraph({100}, &second);
  EXPECT_EQ(first.modes, second.modes);
  EXPECT_EQ(StatisticsOf(first, 3, 5).redundancy.matrix(),
            StatisticsOf(second, 3, 5).redundancy.matrix());
}

}  // namespace
}  // namespace shiftmap
