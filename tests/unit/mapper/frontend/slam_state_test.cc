// SPDX-License-Identifier: Apache-2.0
#include "mapper/frontend/slam_state.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <Eigen/QR>
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

// A vehicle that saw two of three landmarks, of which it knew one.
SlamState SmallState(double seed_offset) {
  SlamState state((Calibration()));
  Eigen::Matrix2d cov;
  cov << 0.04, 0.01, 0.01, 0.02;
  const Eigen::Vector2d known(3.0, 1.0);
  state.AddKnown({&known, 1}, cov);
  Eigen::Matrix3d start = Eigen::Vector3d(0.04, 0.02, 0.01).asDiagonal();
  state.StartFrom({Se2(0.1, -0.2, 0.3), start}, Calibration());
  Observation observation;
  observation.kind = Observation::Kind::kCartesian;
  observation.z = {2.0 + seed_offset, 0.5};
  const SlamPair pair{0, &observation};
  state.Update({&pair, 1});
  observation.z = {1.0, 2.0 - seed_offset};
  state.Add(observation);
  return state;
}

TEST(SlamState, KnownLandmarksAreIndependentOfTheStart) {
  SlamState state((Calibration()));
  const std::vector<Eigen::Vector2d> positions = {{1.0, 2.0}, {3.0, 4.0}};
  Eigen::Matrix4d cov = Eigen::Matrix4d::Identity() * 0.1;
  cov(0, 2) = cov(2, 0) = 0.05;
  EXPECT_EQ(state.AddKnown(positions, cov), 0);
  state.StartFrom({Se2(1.0, 0.0, 0.5), Eigen::Matrix3d::Identity()}, Calibration());
  EXPECT_EQ((state.LandmarkCovariance({0, 1}) - cov).norm(), 0.0);
  const SlamState::Relative relative = state.RelativeTo(1);
  const Se2 pose(1.0, 0.0, 0.5);
  EXPECT_LT((relative.q_vehicle - pose.Inverse() * positions[1]).norm(), 1e-12);
  // dq/dξ = (-I, (q.y, -q.x)), and the landmark turned.
  Eigen::Matrix<double, 2, 3> H;
  H << -1.0, 0.0, relative.q_vehicle.y(), 0.0, -1.0, -relative.q_vehicle.x();
  const Eigen::Matrix2d expected = H * H.transpose() + Eigen::Matrix2d::Identity() * 0.1;
  EXPECT_LT((relative.cov - expected).norm(), 1e-12);
}

// Another vehicle knows nothing of where the last one was.
TEST(SlamState, AStartForgetsThePoseAndKeepsTheMap) {
  SlamState state = SmallState(0.1);
  const Eigen::MatrixXd before = state.LandmarkCovariance({0, 1});
  const Eigen::Vector2d position = state.Position(1);
  const Eigen::Matrix3d start = Eigen::Matrix3d::Identity() * 0.01;
  state.StartFrom({Se2(5.0, 5.0, 1.0), start}, Calibration());
  EXPECT_EQ((state.LandmarkCovariance({0, 1}) - before).norm(), 0.0);
  EXPECT_EQ(state.Position(1), position);
  // Of a pose and landmarks that are independent, covariances add.
  const Eigen::Vector2d q = state.RelativeTo(1).q_vehicle;
  Eigen::Matrix<double, 2, 3> H;
  H << -1.0, 0.0, q.y(), 0.0, -1.0, -q.x();
  const Eigen::Matrix2d R = state.pose().Rotation();
  const Eigen::Matrix2d expected =
      H * start * H.transpose() + R.transpose() * state.PositionCovariance(1) * R;
  EXPECT_LT((state.RelativeTo(1).cov - expected).norm(), 1e-12);
}

// What all landmarks are off by together is not seen from a pose among them, however large it is,
// and no sighting from there tells of it.
TEST(SlamState, AStartAmongLandmarksIsOffAsTheyAre) {
  const std::vector<Eigen::Vector2d> positions = {{1.0, 2.0}, {3.0, 4.0}, {-2.0, 6.0}};
  const PoseWithCovariance start{Se2(1.0, 0.0, 0.5), Eigen::Matrix3d::Identity() * 0.01};
  Eigen::Matrix<double, 6, 3> rigid;
  for (int i = 0; i < 3; ++i) {
    const Eigen::Vector2d p = positions[static_cast<std::size_t>(i)];
    rigid.middleRows<2>(2 * i) << 1.0, 0.0, -p.y(), 0.0, 1.0, p.x();
  }
  const Eigen::Vector3d common(4.0, 1.0, 0.01);  // (0.5 m)² and more.
  std::vector<SlamState> states;
  for (const double share : {0.0, 1.0}) {
    SlamState& state = states.emplace_back(Calibration());
    state.AddKnown(positions,
                   Eigen::MatrixXd::Identity(6, 6) * 0.01 +
                       share * rigid * common.asDiagonal() * rigid.transpose());
    state.StartFrom(start, Calibration());
    state.TieStartTo({0, 1, 2});
  }
  for (const int landmark : {0, 1, 2}) {
    const Eigen::Matrix2d alone = states[0].RelativeTo(landmark).cov;
    EXPECT_LT((states[1].RelativeTo(landmark).cov - alone).norm(), 1e-9);
  }
  const Eigen::MatrixXd G = rigid.householderQr().householderQ() * Eigen::MatrixXd::Identity(6, 3);
  const auto of_common = [&](const SlamState& state) -> Eigen::Matrix3d {
    return G.transpose() * state.LandmarkCovariance({0, 1, 2}) * G;
  };
  const Eigen::Matrix3d before = of_common(states[1]);
  Observation observation;
  observation.kind = Observation::Kind::kCartesian;
  for (int i = 0; i < 30; ++i) {
    for (const int landmark : {0, 1, 2}) {
      observation.z = start.T_map_vehicle.Inverse() * positions[static_cast<std::size_t>(landmark)];
      const SlamPair pair{landmark, &observation};
      states[1].Update({&pair, 1});
    }
  }
  EXPECT_LT((of_common(states[1]) - before).norm(), 1e-6 * before.norm());
}

// One landmark tells no heading: the start stays as it is.
TEST(SlamState, AStartIsNotTiedToOneLandmark) {
  SlamState state = SmallState(0.1);
  const PoseWithCovariance start{Se2(5.0, 5.0, 1.0), Eigen::Matrix3d::Identity() * 0.01};
  state.StartFrom(start, Calibration());
  state.TieStartTo({1});
  EXPECT_EQ(state.PoseCovariance(), start.cov_T_map_vehicle);
}

// First and second moments of the mixture, which do not depend on which of the two is asked.
TEST(SlamState, AMixtureHasTheMomentsOfBoth) {
  const SlamState a = SmallState(0.1);
  const SlamState b = SmallState(-0.05);
  ASSERT_TRUE(a.HasLandmarksOf(b));
  SlamState mixed = a;
  mixed.MixWith(b, 0.25);
  const std::vector<int> all = {0, 1};
  Eigen::Vector4d mean_a;
  mean_a << a.Position(0), a.Position(1);
  Eigen::Vector4d mean_b;
  mean_b << b.Position(0), b.Position(1);
  const Eigen::Vector4d mean = 0.75 * mean_a + 0.25 * mean_b;
  const Eigen::Matrix4d second = 0.75 * (a.LandmarkCovariance(all) + mean_a * mean_a.transpose()) +
                                 0.25 * (b.LandmarkCovariance(all) + mean_b * mean_b.transpose());
  EXPECT_LT((mixed.Position(1) - mean.tail<2>()).norm(), 1e-12);
  EXPECT_LT((mixed.LandmarkCovariance(all) + mean * mean.transpose() - second).norm(), 1e-12);
  const Eigen::Vector3d between = (a.pose().Inverse() * b.pose()).Log();
  EXPECT_LT(((a.pose().Inverse() * mixed.pose()).Log() - 0.25 * between).norm(), 1e-12);
  SlamState other = b;
  other.MixWith(a, 0.75);
  EXPECT_LT((other.LandmarkCovariance(all) - mixed.LandmarkCovariance(all)).norm(), 1e-12);
}

TEST(SlamState, DistanceOfTwoEstimatesIsTheirMahalanobisDistance) {
  const SlamState a = SmallState(0.1);
  EXPECT_NEAR(a.SquaredDistanceTo(a), 0.0, 1e-12);
  const SlamState b = SmallState(0.0);
  EXPECT_NEAR(a.SquaredDistanceTo(b), b.SquaredDistanceTo(a), 0.02 * a.SquaredDistanceTo(b));
  EXPECT_GT(a.SquaredDistanceTo(SmallState(-0.2)), a.SquaredDistanceTo(b));
}

// What a state knows of a turn of everything about the origin: nᵀ P⁻¹ n with n the direction of
// that turn at the estimate.
double InformationOfTurn(const SlamState& state) {
  const auto turned = [](const Eigen::Vector2d& v) { return Eigen::Vector2d(-v.y(), v.x()); };
  const std::vector<int>& landmarks = state.active();
  const auto size = static_cast<Eigen::Index>(3 + 2 * landmarks.size());
  Eigen::VectorXd n(size);
  n.head<2>() = state.pose().Rotation().transpose() * turned(state.pose().translation());
  n(2) = 1.0;
  for (std::size_t i = 0; i < landmarks.size(); ++i) {
    n.segment<2>(static_cast<Eigen::Index>(3 + 2 * i)) = turned(state.Position(landmarks[i]));
  }
  return n.dot(state.PoseAndLandmarkCovariance().llt().solve(n));
}

// No observation between vehicle and landmarks tells of a turn of the whole.
TEST(SlamState, InvariantErrorsLearnNothingOfATurnOfTheWhole) {
  for (const SlamState::Errors errors :
       {SlamState::Errors::kPrinted, SlamState::Errors::kInvariant}) {
    SlamState state(Calibration(), errors);
    Eigen::Matrix3d start = Eigen::Vector3d(1.0, 1.0, 0.3).asDiagonal();
    state.StartFrom({Se2(5.0, 2.0, 0.4), start}, Calibration());
    Observation observation;
    observation.kind = Observation::Kind::kCartesian;
    for (const Eigen::Vector2d& z : {Eigen::Vector2d(3.0, 1.0), Eigen::Vector2d(2.0, -2.0)}) {
      observation.z = z;
      state.Add(observation);
    }
    MotionIncrement motion;
    motion.T_begin_end = Se2(0.5, 0.1, 0.2);
    motion.cov = Eigen::Vector3d(0.2, 0.2, 0.1).asDiagonal();
    state.Predict(motion);
    const double before = InformationOfTurn(state);
    observation.z = {3.3, -0.6};  // Far from where it is expected: the estimate moves.
    const SlamPair pair{0, &observation};
    state.Update({&pair, 1});
    if (errors == SlamState::Errors::kInvariant) {
      EXPECT_NEAR(InformationOfTurn(state), before, 1e-6 * before);
    } else {
      EXPECT_GT(InformationOfTurn(state), 1.001 * before);
    }
  }
}

}  // namespace
}  // namespace shiftmap
