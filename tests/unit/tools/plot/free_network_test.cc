// SPDX-License-Identifier: Apache-2.0
#include "tools/plot/free_network.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <vector>

#include "mapstore/geometry/se2.h"
#include "mapstore/map/frame_change.h"
#include "tests/support/geometry_matchers.h"

namespace shiftmap {
namespace {

constexpr int kModes = 8;

// Modes on a circle, each in a group of its own.
MapContent Circle(const Eigen::MatrixXd& cov) {
  MapContent content;
  std::vector<Eigen::Matrix2d> diagonal;
  for (int i = 0; i < kModes; ++i) {
    LandmarkGroup group;
    group.signature = Signature(std::string(1, static_cast<char>('a' + i)));
    Mode mode;
    mode.number = ModeNumber(1);
    mode.p_map_landmark = Eigen::Vector2d(30.0 + 5.0 * std::cos(i), -4.0 + 7.0 * std::sin(i));
    mode.cov_p_map_landmark = cov.block<2, 2>(2 * i, 2 * i);
    group.modes.push_back(mode);
    content.groups.push_back(group);
  }
  content.covariance = JointCovariance::FromDense(cov);
  return content;
}

// How the frame of the circle may lie: 1 m and 0.1 rad about the origin, far off.
Eigen::MatrixXd FrameCovariance(const MapContent& content) {
  Eigen::MatrixXd G(2 * kModes, 3);
  for (int i = 0; i < kModes; ++i) {
    const Eigen::Vector2d& p = content.groups[static_cast<std::size_t>(i)].modes[0].p_map_landmark;
    G.middleRows<2>(2 * i) << 1.0, 0.0, -p.y(), 0.0, 1.0, p.x();
  }
  return G * Eigen::Vector3d(1.0, 1.0, 0.01).asDiagonal() * G.transpose();
}

Eigen::MatrixXd Noise() { return 1e-4 * Eigen::MatrixXd::Identity(2 * kModes, 2 * kModes); }

const Eigen::Matrix2d& CovOf(const MapContent& content, int mode) {
  return content.groups[static_cast<std::size_t>(mode)].modes[0].cov_p_map_landmark;
}

TEST(FreeNetworkTest, WhatTheFrameLeavesOpenIsGone) {
  const MapContent still = Circle(Noise());
  const Eigen::MatrixXd frame = FrameCovariance(still);
  const MapContent with_frame = FreeNetwork(Circle(Noise() + frame)).content;
  // The same network in another frame.
  const MapContent other = FreeNetwork(Circle(Noise() + 4.0 * frame)).content;
  double trace = 0.0;
  for (int i = 0; i < kModes; ++i) {
    EXPECT_LT((CovOf(with_frame, i) - CovOf(other, i)).norm(), 1e-9);
    trace += CovOf(with_frame, i).trace();
  }
  // Three of the degrees of freedom are the frame's, and one is the scale's.
  EXPECT_NEAR(trace, 1e-4 * (2 * kModes - 4), 1e-9);
}

// A map that is 3 % too large or too small as a whole.
TEST(FreeNetworkTest, AnErrorOfTheScaleIsToldApart) {
  const MapContent still = Circle(Noise());
  Eigen::VectorXd away(2 * kModes);
  for (int i = 0; i < kModes; ++i) {
    away.segment<2>(2 * i) = still.groups[static_cast<std::size_t>(i)].modes[0].p_map_landmark;
  }
  const Eigen::MatrixXd scale = 0.03 * 0.03 * away * away.transpose();
  const FreeMap free = FreeNetwork(Circle(1e-6 * Noise() + scale));
  EXPECT_NEAR(free.scale_sd, 0.03, 1e-4);
  for (int i = 0; i < kModes; ++i) EXPECT_LT(CovOf(free.content, i).norm(), 1e-8);
}

TEST(FreeNetworkTest, AMapThatMovesHasTheSameEllipsesTurned) {
  MapContent content = Circle(Noise() + FrameCovariance(Circle(Noise())));
  const Se2 T(100.0, -7.0, 0.6);
  MapContent moved = content;
  MoveContent(T, &moved);
  const MapContent free = FreeNetwork(content).content;
  const MapContent free_moved = FreeNetwork(moved).content;
  for (int i = 0; i < kModes; ++i) {
    const Eigen::Matrix2d turned = T.Rotation() * CovOf(free, i) * T.Rotation().transpose();
    EXPECT_LT((CovOf(free_moved, i) - turned).norm(), 1e-9);
  }
}

// Two tiles that no block connects: each is a network of its own, whatever the other one is.
TEST(FreeNetworkTest, EachNetworkIsFreedByItself) {
  const int half = kModes;
  const Eigen::MatrixXd connected = Noise() + FrameCovariance(Circle(Noise()));
  Eigen::MatrixXd cov = Eigen::MatrixXd::Zero(2 * kModes, 2 * kModes);
  cov.topLeftCorner(half, half) = connected.topLeftCorner(half, half);
  cov.bottomRightCorner(half, half) = connected.bottomRightCorner(half, half);
  Eigen::MatrixXd larger = cov;
  larger.bottomRightCorner(half, half) *= 9.0;
  const MapContent free = FreeNetwork(Circle(cov)).content;
  const MapContent of_larger = FreeNetwork(Circle(larger)).content;
  for (int i = 0; i < kModes; ++i) {
    const double factor = i < kModes / 2 ? 1.0 : 9.0;
    EXPECT_LT((CovOf(of_larger, i) - factor * CovOf(free, i)).norm(), 1e-9);
    EXPECT_LT(CovOf(free, i).trace(), 3e-4);
  }
}

TEST(FreeNetworkTest, ModesAtOnePlaceStay) {
  MapContent content = Circle(Noise() + FrameCovariance(Circle(Noise())));
  for (LandmarkGroup& group : content.groups) group.modes[0].p_map_landmark.setConstant(0.1);
  const FreeMap free = FreeNetwork(content);
  EXPECT_EQ(free.scale_sd, 0.0);
  for (int i = 0; i < kModes; ++i) EXPECT_EQ(CovOf(free.content, i), CovOf(content, i));
}

TEST(FreeNetworkTest, SurveyedModesThatAreByThemselvesStay) {
  const MapContent content = Circle(Noise());
  const MapContent free = FreeNetwork(content).content;
  for (int i = 0; i < kModes; ++i) EXPECT_EQ(CovOf(free, i), CovOf(content, i));
}

}  // namespace
}  // namespace shiftmap
