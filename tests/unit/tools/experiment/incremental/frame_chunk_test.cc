// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/incremental/frame_chunk.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>

#include "tests/support/geometry_matchers.h"
#include "tests/unit/tools/experiment/incremental/small_site.h"

namespace shiftmap {
namespace {

using testing::IsNearMatrix;

// The same normal equations without structure: all poses, then calibration and modes.
struct DenseSystem {
  Eigen::MatrixXd H;
  Eigen::VectorXd b;

  void Add(const Eigen::MatrixXd& J, const Eigen::VectorXd& r) {
    H += J.transpose() * J;
    b -= J.transpose() * r;
  }
};

DenseSystem Dense(const Window& window, int first, int end) {
  const Eigen::Index poses = 3 * (end - first + 1);
  const Eigen::Index size =
      poses + kRunCalibration + 2 * static_cast<Eigen::Index>(window.modes.size());
  DenseSystem dense{Eigen::MatrixXd::Zero(size, size), Eigen::VectorXd::Zero(size)};
  if (first == 0) {
    const MotionResidual::Linear start = LinearizeStart(window);
    Eigen::MatrixXd J = Eigen::MatrixXd::Zero(3, size);
    J.leftCols<3>() = start.J_j;
    dense.Add(J, start.r);
  }
  for (int f = first; f < end; ++f) {
    const Eigen::Index at = 3 * (f - first);
    const MotionResidual::Linear motion = LinearizeMotion(window, static_cast<std::size_t>(f));
    Eigen::MatrixXd J = Eigen::MatrixXd::Zero(3, size);
    J.middleCols<3>(at) = motion.J_i;
    J.middleCols<3>(at + 3) = motion.J_j;
    J.middleCols<4>(poses) = motion.J_calibration;
    dense.Add(J, motion.r);
    const WindowFrame& frame = window.frames[static_cast<std::size_t>(f)];
    for (const WindowObservation& observation : frame.observations) {
      const ObservationResidual::Linear seen = LinearizeObservation(window, frame, observation);
      Eigen::MatrixXd K = Eigen::MatrixXd::Zero(2, size);
      K.middleCols<3>(at) = seen.J_pose;
      K.middleCols<3>(poses + 3) = seen.J_bias;
      K.middleCols<2>(poses + kRunCalibration + 2 * observation.mode) = seen.J_landmark;
      dense.Add(K, seen.r);
    }
  }
  return dense;
}

// Schur complement of the leading block.
DenseSystem Marginal(const DenseSystem& dense, Eigen::Index gone) {
  const Eigen::Index kept = dense.b.size() - gone;
  const Eigen::MatrixXd gain =
      dense.H.bottomLeftCorner(kept, gone) * dense.H.topLeftCorner(gone, gone).inverse();
  return {dense.H.bottomRightCorner(kept, kept) - gain * dense.H.topRightCorner(gone, kept),
          dense.b.tail(kept) - gain * dense.b.head(gone)};
}

Window SiteWindow() {
  testing::SiteShape shape;
  shape.frames = 21;
  shape.start_sd = 0.3;
  const Graph graph = testing::MakeSmallSite(shape, 9);
  FixedLagSmoother smoother(testing::OptionsOf(graph), testing::StartOf(shape, graph));
  testing::AddModes(graph, &smoother);
  for (int f = 0; f < shape.frames; ++f) testing::AddNextFrame(graph, f, &smoother);
  // Where a step was taken, so that origins and estimates differ.
  smoother.Solve(1);
  return smoother.window();
}

TEST(FrameChunkTest, CarriesTheSchurComplement) {
  const Window window = SiteWindow();
  FrameChunk first(0, 8);
  FrameChunk second(8, 20);
  ASSERT_TRUE(first.Eliminate(window, CarriedSystem()));
  ASSERT_TRUE(second.Eliminate(window, first.carried()));
  const DenseSystem expected = Marginal(Dense(window, 0, 20), 60);
  const Eigen::MatrixXd H = second.carried().H.selfadjointView<Eigen::Lower>();
  const double scale = expected.H.cwiseAbs().maxCoeff();
  EXPECT_THAT(H, IsNearMatrix(expected.H, 1e-10 * scale));
  EXPECT_THAT(second.carried().b,
              IsNearMatrix(expected.b, 1e-10 * expected.b.cwiseAbs().maxCoeff()));
}

TEST(FrameChunkTest, BackSubstitutionSolvesTheWholeSystem) {
  Window window = SiteWindow();
  FrameChunk chunk(0, 20);
  ASSERT_TRUE(chunk.Eliminate(window, CarriedSystem()));
  DenseSystem dense = Dense(window, 0, 20);
  const Eigen::Index gone = 60;
  const Eigen::Index kept = dense.b.size() - gone;
  const Eigen::VectorXd steps = Eigen::VectorXd::LinSpaced(kept, -0.01, 0.02);
  const Eigen::VectorXd poses =
      dense.H.topLeftCorner(gone, gone)
          .ldlt()
          .solve(dense.b.head(gone) - dense.H.topRightCorner(gone, kept) * steps);
  window.frames[20].step = steps.head<3>();
  chunk.BackSubstitute(steps, &window);
  for (int f = 0; f < 20; ++f) {
    EXPECT_THAT(window.frames[static_cast<std::size_t>(f)].step,
                IsNearMatrix(Eigen::Vector3d(poses.segment<3>(3 * f)), 1e-9));
  }
}

TEST(FrameChunkTest, KnowsOnlyWhatItsFramesSaw) {
  const Window window = SiteWindow();
  FrameChunk chunk(0, 2);
  ASSERT_TRUE(chunk.Eliminate(window, CarriedSystem()));
  std::vector<bool> seen(window.modes.size());
  for (std::size_t f = 0; f < 2; ++f) {
    for (const WindowObservation& observation : window.frames[f].observations) {
      seen[static_cast<std::size_t>(observation.mode)] = true;
    }
  }
  for (std::size_t m = 0; m < seen.size(); ++m) {
    EXPECT_EQ(chunk.carried().Knows(ModeColumn(static_cast<int>(m))), seen[m]) << m;
  }
}

}  // namespace
}  // namespace shiftmap
