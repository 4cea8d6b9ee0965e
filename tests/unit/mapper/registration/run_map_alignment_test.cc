// SPDX-License-Identifier: Apache-2.0
#include "mapper/registration/run_map_alignment.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

#include "mapper/covariance/gauge.h"
#include "tests/support/random_map.h"

namespace shiftmap {
namespace {

constexpr int kLandmarks = 96;
constexpr double kSpacing = 5.0;  // [m]

// A road that a run by itself takes for an arc.
struct DeformedRoad {
  AlignmentPoints reference;
  RunMap run_map;
};

DeformedRoad MakeDeformedRoad(double turn_rad, std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  DeformedRoad road;
  std::vector<Eigen::Vector2d> positions;
  Eigen::Vector2d along = Eigen::Vector2d::Zero();
  for (int i = 0; i < kLandmarks; ++i) {
    const double yaw = turn_rad * i / kLandmarks;
    const double side = i % 2 == 0 ? 3.0 : -3.0;
    const Eigen::Vector2d noise(0.02 * normal(random), 0.02 * normal(random));
    road.reference.push_back({GroupIndex(i), {kSpacing * i, side}});
    positions.emplace_back(along + side * Eigen::Vector2d(-std::sin(yaw), std::cos(yaw)) + noise);
    along += kSpacing * Eigen::Vector2d(std::cos(yaw), std::sin(yaw));
  }
  // The deform as the one thing that is not known, and a little of everything.
  Eigen::MatrixXd deform(2 * kLandmarks, 1);
  for (int i = 0; i < kLandmarks; ++i) {
    deform(2 * i, 0) = 0.0;
    deform(2 * i + 1, 0) = 0.5 * turn_rad * kSpacing * i * i / kLandmarks;
  }
  const Eigen::MatrixXd cov = deform * deform.transpose() +
                              1e-3 * Eigen::MatrixXd::Identity(2 * kLandmarks, 2 * kLandmarks);
  road.run_map.covariance = ReferToPositions(positions, cov);
  for (int i = 0; i < kLandmarks; ++i) {
    road.run_map.points.push_back({GroupIndex(i),
                                   positions[static_cast<std::size_t>(i)],
                                   road.run_map.covariance.block<2, 2>(2 * i, 2 * i)});
  }
  return road;
}

TEST(AlignRunMap, FindsTheModesOfADeformedRunMapPartByPart) {
  std::mt19937_64 random(testing::TestSeed(98));
  const DeformedRoad road = MakeDeformedRoad(0.5, random);
  const auto aligned = AlignRunMap(road.reference, road.run_map, 1e5, {});
  ASSERT_TRUE(aligned.has_value());
  EXPECT_TRUE(aligned->deformed);
  int found = 0;
  for (const ModeIndex i : aligned->places.indices()) {
    const std::optional<Eigen::Vector2d>& place = aligned->places[i];
    if (!place) continue;
    ++found;
    EXPECT_LT((*place - road.reference[i].position).norm(), 2.5) << i.value();
  }
  EXPECT_GT(found, kLandmarks / 3);
}

TEST(AlignRunMap, WhatCountsAsDeformedIsAnOption) {
  std::mt19937_64 random(testing::TestSeed(98));
  const RunMap run_map = MakeDeformedRoad(0.5, random).run_map;
  EXPECT_TRUE(IsDeformable(run_map, {}));
  EXPECT_FALSE(IsDeformable(run_map, {.deformed_sd_m = 100.0}));
  EXPECT_FALSE(IsDeformable(run_map, {.part_modes = kLandmarks}));
}

TEST(AlignRunMap, TakesARigidRunMapAsAWhole) {
  std::mt19937_64 random(testing::TestSeed(99));
  const DeformedRoad road = MakeDeformedRoad(0.0, random);
  const auto aligned = AlignRunMap(road.reference, road.run_map, 1e5, {});
  ASSERT_TRUE(aligned.has_value());
  EXPECT_FALSE(aligned->deformed);
  EXPECT_GT(aligned->alignment.signatures.size(), kLandmarks * 9 / 10);
}

TEST(AlignRunMap, AnotherPlaceIsNone) {
  std::mt19937_64 random(testing::TestSeed(100));
  DeformedRoad road = MakeDeformedRoad(0.5, random);
  std::uniform_real_distribution<double> anywhere(0.0, 500.0);
  for (AlignmentPoint& point : road.reference)
    point.position = {anywhere(random), anywhere(random)};
  EXPECT_FALSE(AlignRunMap(road.reference, road.run_map, 2.5e5, {}).has_value());
}

}  // namespace
}  // namespace shiftmap
