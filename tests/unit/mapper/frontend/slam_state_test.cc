// SPDX-License-Identifier: Apache-2.0
#include "mapper/frontend/slam_state.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <cmath>
#include <numbers>
#include <random>

#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

constexpr double kReach = 25.0;

// Landmarks along a circle that is much longer than the sensor sees, and a vehicle that drives
// around it twice.
struct Circuit {
  std::vector<Eigen::Vector2d> landmarks;
  std::vector<Se2> truth;

  Circuit() {
    constexpr double kRadius = 90.0;
    for (int i = 0; i < 60; ++i) {
      const double angle = 2.0 * std::numbers::pi * i / 60.0;
      const double radius = kRadius + (i % 3 - 1) * 8.0;
      landmarks.emplace_back(radius * std::sin(angle), kRadius - radius * std::cos(angle));
    }
    for (int i = 0; i < 240; ++i) {
      truth.push_back(i == 0 ? Se2()
                             : truth.back() * Se2::Exp({2.0 * std::numbers::pi * kRadius / 120.0,
                                                        0.0,
                                                        2.0 * std::numbers::pi / 120.0}));
    }
  }
};

Observation See(const Se2& pose, const Eigen::Vector2d& landmark, std::mt19937_64* random) {
  std::normal_distribution<double> noise(0.0, 0.1);
  Observation observation;
  observation.kind = Observation::Kind::kCartesian;
  observation.z = pose.Inverse() * landmark;
  observation.z += Eigen::Vector2d(noise(*random), noise(*random));
  return observation;
}

MotionIncrement Motion(const Se2& from, const Se2& to, std::mt19937_64* random) {
  std::normal_distribution<double> normal;
  const Eigen::Vector3d sd(0.1, 0.05, 0.01);
  MotionIncrement motion;
  const Eigen::Vector3d error(normal(*random), normal(*random), normal(*random));
  motion.T_begin_end = from.Inverse() * to * Se2::Exp(sd.cwiseProduct(error));
  motion.cov = sd.cwiseAbs2().asDiagonal();
  motion.J_calibration(0, 0) = motion.T_begin_end.x();
  motion.J_calibration(2, 1) = motion.T_begin_end.yaw();
  return motion;
}

// Drives the circuit with a filter whose active set reaches as far as given.
SlamState Drive(const Circuit& circuit, double reach_m, std::vector<int>* id_of) {
  Calibration calibration;
  calibration.sensor.sd_position_m = 0.1;
  SlamState state(calibration);
  std::mt19937_64 random(3);
  id_of->assign(circuit.landmarks.size(), -1);
  int removed = 0;
  for (std::size_t t = 0; t < circuit.truth.size(); ++t) {
    if (t > 0) state.Predict(Motion(circuit.truth[t - 1], circuit.truth[t], &random));
    state.Focus(reach_m);
    std::vector<Observation> observations;
    std::vector<int> seen;
    for (std::size_t i = 0; i < circuit.landmarks.size(); ++i) {
      if ((circuit.landmarks[i] - circuit.truth[t].translation()).norm() > kReach) continue;
      observations.push_back(See(circuit.truth[t], circuit.landmarks[i], &random));
      seen.push_back(static_cast<int>(i));
    }
    std::vector<SlamPair> pairs;
    for (std::size_t i = 0; i < seen.size(); ++i) {
      int& id = (*id_of)[static_cast<std::size_t>(seen[i])];
      if (id < 0) {
        id = state.Add(observations[i]);
      } else {
        pairs.push_back({id, &observations[i]});
      }
    }
    state.Update(pairs);
    // One landmark is removed while the vehicle is far from it, one while it is near.
    if ((t == 100 || t == 130) && removed < 2) {
      int& id = (*id_of)[t == 100 ? std::size_t{5} : std::size_t{4}];
      state.Remove(id);
      id = -1;
      ++removed;
    }
  }
  return state;
}

TEST(SlamState, CompressionChangesNothing) {
  const Circuit circuit;
  std::vector<int> ids;
  std::vector<int> full_ids;
  SlamState compressed = Drive(circuit, kReach + 5.0, &ids);
  const SlamState full = Drive(circuit, 1e6, &full_ids);
  EXPECT_LT(compressed.active().size(), 40U);
  EXPECT_EQ(full.active().size(), circuit.landmarks.size());
  EXPECT_EQ(ids, full_ids);

  EXPECT_NEAR((compressed.pose().Inverse() * full.pose()).Log().norm(), 0.0, 1e-8);
  EXPECT_LT((compressed.PoseCovariance() - full.PoseCovariance()).norm(), 1e-9);
  compressed.Focus(1e6);
  for (const int id : ids) {
    if (id < 0) continue;
    EXPECT_LT((compressed.Position(id) - full.Position(id)).norm(), 1e-8) << id;
    EXPECT_LT((compressed.PositionCovariance(id) - full.PositionCovariance(id)).norm(), 1e-9) << id;
    EXPECT_LT(
        (compressed.DifferenceCovariance(ids[0], id) - full.DifferenceCovariance(full_ids[0], id))
            .norm(),
        1e-9)
        << id;
  }
}

TEST(SlamState, MapsTheCircuit) {
  const Circuit circuit;
  std::vector<int> ids;
  SlamState state = Drive(circuit, kReach + 5.0, &ids);
  state.Focus(1e6);
  double squares = 0.0;
  for (std::size_t i = 0; i < ids.size(); ++i) {
    if (ids[i] >= 0) squares += (state.Position(ids[i]) - circuit.landmarks[i]).squaredNorm();
  }
  EXPECT_LT(std::sqrt(squares / static_cast<double>(ids.size())), 2.5);
}

// In a world where everything is linear, the joint update of all pairs is one least-squares fit.
TEST(SlamState, JointUpdateIsLeastSquares) {
  Calibration calibration;
  calibration.sensor.sd_position_m = 0.2;
  SlamState state(calibration);
  Observation first;
  first.kind = Observation::Kind::kCartesian;
  first.z = {3.0, 1.0};
  Observation second = first;
  second.z = {-2.0, 4.0};
  const int a = state.Add(first);
  const int b = state.Add(second);
  Observation again = first;
  again.z = {3.4, 0.8};
  Observation also = second;
  also.z = {-2.2, 4.2};
  const std::vector<SlamPair> pairs = {{a, &again}, {b, &also}};
  const JointInnovation joint = state.Innovate(pairs);
  EXPECT_NEAR(joint.S(0, 0), 0.08, 1e-12);
  EXPECT_NEAR(joint.S(0, 2), 0.0, 1e-12);
  state.Update(pairs);
  // The first pose is certain, so each position is the mean of its two sightings.
  EXPECT_LT((state.Position(a) - Eigen::Vector2d(3.2, 0.9)).norm(), 1e-9);
  EXPECT_LT((state.Position(b) - Eigen::Vector2d(-2.1, 4.1)).norm(), 1e-9);
  EXPECT_NEAR(state.PositionCovariance(a)(0, 0), 0.02, 1e-12);
}

TEST(SlamState, InnovationsOfOneScanShareThePoseError) {
  SlamState state({});
  Observation observation;
  observation.kind = Observation::Kind::kCartesian;
  observation.z = {5.0, 0.0};
  const int a = state.Add(observation);
  MotionIncrement motion;
  motion.cov = Eigen::Vector3d(0.5, 0.5, 0.0).asDiagonal();
  state.Predict(motion);
  const std::vector<SlamPair> pairs = {{a, &observation}, {a, &observation}};
  const JointInnovation joint = state.Innovate(pairs);
  const double sd = SensorCalibration().sd_position_m;
  EXPECT_NEAR(joint.S(0, 2), 0.5 + sd * sd, 1e-9);
  EXPECT_NEAR(joint.S(0, 0), 0.5 + 2.0 * sd * sd, 1e-9);
  Eigen::Matrix2d S;
  state.Linearized(pairs[0], &S);
  EXPECT_LT((S - joint.S.topLeftCorner<2, 2>()).norm(), 1e-12);
}

TEST(SlamState, FusedLandmarksAreOne) {
  SlamState state({});
  Observation observation;
  observation.kind = Observation::Kind::kCartesian;
  observation.z = {5.0, 0.0};
  const int a = state.Add(observation);
  observation.z = {5.3, 0.0};
  const int b = state.Add(observation);
  state.Fuse(a, b);
  EXPECT_EQ(state.active(), std::vector<int>{a});
  EXPECT_NEAR(state.Position(a).x(), 5.15, 1e-4);
  const double sd = SensorCalibration().sd_position_m;
  EXPECT_NEAR(state.PositionCovariance(a)(0, 0), 0.5 * sd * sd, 1e-5);
}

}  // namespace
}  // namespace shiftmap
