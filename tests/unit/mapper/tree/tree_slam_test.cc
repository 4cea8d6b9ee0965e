// SPDX-License-Identifier: Apache-2.0
#include "mapper/tree/tree_slam.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

#include "localizer/models/detection_model.h"
#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

constexpr double kSd = 0.1;

Calibration TestCalibration() {
  Calibration calibration;
  calibration.odometry.sd_log_scale = 0.0;
  calibration.sensor.sd_position_m = kSd;
  calibration.sensor.max_range_m = 10.0;
  calibration.sensor.max_bearing_rad = 3.2;
  calibration.sensor.detection_probability = 0.8;
  calibration.sensor.clutter_density_per_m2 = 1e-4;
  calibration.sensor.new_landmark_density_per_m2 = 3e-4;
  return calibration;
}

Observation At(const std::string& signature, double x, double y) {
  Observation observation;
  observation.signature = Signature(signature);
  observation.kind = Observation::Kind::kCartesian;
  observation.z = {x, y};
  return observation;
}

Scan ScanOf(double t_s, const std::vector<Observation>& observations) {
  return {StampFromSeconds(1000.0 + t_s), observations};
}

// A landmark 18 with one mode at (4, 0), known to 0.1 m, and that with probability 0.9.
MapContent OneMode() {
  MapContent content;
  LandmarkGroup group;
  group.signature = Signature("18");
  Mode mode;
  mode.number = ModeNumber(1);
  mode.p_map_landmark = {4.0, 0.0};
  mode.cov_p_map_landmark = Eigen::Matrix2d::Identity() * 0.01;
  group.modes = {mode};
  group.chain = ModeChain::Uniform(1, 0.0);
  group.probabilities = Eigen::Vector2d(0.1, 0.9);
  content.covariance = JointCovariance({mode.cov_p_map_landmark}, {});
  content.groups = {group};
  content.stamp = StampFromSeconds(1000.0);
  return content;
}

TreeSlam Standing(const TreeSlamOptions& options, const std::optional<MapContent>& prior) {
  TreeSlam slam(options, TestCalibration(), prior);
  slam.BeginRun({}, TestCalibration(), StampFromSeconds(1000.0));
  return slam;
}

double MissOnce() {
  const SensorCalibration sensor = TestCalibration().sensor;
  return std::exp(
      LogMissedRun(std::log1p(-sensor.detection_probability), sensor.occluded_visit_probability));
}

// Density of an observation `apart` from where a landmark with variance `variance` is expected.
double Density(double apart, double variance) {
  return std::exp(LogGaussian({apart, 0.0}, Eigen::Matrix2d::Identity() * (variance + kSd * kSd)));
}

void ExpectProbabilities(const TreeSlam& slam, std::vector<double> weights) {
  double sum = 0.0;
  for (const double weight : weights) sum += weight;
  const Eigen::VectorXd p = slam.Probabilities(0);
  ASSERT_EQ(p.size(), static_cast<Eigen::Index>(weights.size()));
  for (std::size_t i = 0; i < weights.size(); ++i) {
    EXPECT_NEAR(p(static_cast<Eigen::Index>(i)), weights[i] / sum, 5e-6) << "state " << i;
  }
}

TEST(TreeSlam, AnUngatedObservationIsWeighedByHand) {
  const SensorCalibration sensor = TestCalibration().sensor;
  const double fa = sensor.clutter_density_per_m2;
  const double nt = sensor.new_landmark_density_per_m2;
  TreeSlam slam = Standing({}, OneMode());
  slam.Correct(ScanOf(0.0, {At("18", 4.0, 3.0)}));
  // Clutter and absent; clutter and at the mode, which was missed; a new place.
  double absent = 0.1 * fa;
  double known = 0.9 * MissOnce() * fa;
  double found = 0.1 * nt;
  ExpectProbabilities(slam, {absent, known, found});
  EXPECT_EQ(slam.leaves().size(), 1u);  // They share the filter.

  slam.Correct(ScanOf(0.2, {At("18", 4.05, 3.0)}));
  const double missed_twice = std::exp(LogMissedRun(2.0 * std::log1p(-sensor.detection_probability),
                                                    sensor.occluded_visit_probability));
  absent *= fa + nt;
  known = 0.9 * missed_twice * fa * fa;
  // The place was seen, or not and this is clutter.
  found = found * sensor.detection_probability * Density(0.05, kSd * kSd) + found * MissOnce() * fa;
  ExpectProbabilities(slam, {absent, known, found});
}

TEST(TreeSlam, TheAlternativeMayTurnIntoTheModeThatIsFound) {
  const SensorCalibration sensor = TestCalibration().sensor;
  const double any = sensor.clutter_density_per_m2 + sensor.new_landmark_density_per_m2;
  TreeSlam slam = Standing({.transform_alternative = true}, OneMode());
  slam.Correct(ScanOf(0.0, {At("18", 4.0, 3.0)}));
  ExpectProbabilities(slam, {0.0, 0.9 * MissOnce() * sensor.clutter_density_per_m2, 0.1 * any});
}

TEST(TreeSlam, SilenceIsBoundedByOcclusion) {
  const SensorCalibration sensor = TestCalibration().sensor;
  TreeSlam slam = Standing({}, OneMode());
  for (int i = 0; i < 30; ++i) slam.Correct(ScanOf(0.2 * i, {}));
  const double silent = std::exp(LogMissedRun(30.0 * std::log1p(-sensor.detection_probability),
                                              sensor.occluded_visit_probability));
  ExpectProbabilities(slam, {0.1, 0.9 * silent});
}

TEST(TreeSlam, OneFalseAlarmMakesNoMode) {
  TreeSlam slam = Standing({}, OneMode());
  for (int i = 0; i < 10; ++i) {
    slam.Correct(ScanOf(0.2 * i, {i == 3 ? At("18", -2.0, 3.0) : At("18", 4.0, 0.0)}));
  }
  slam.EndRun();
  const MapContent content = slam.Content();
  ASSERT_EQ(content.groups.size(), 1u);
  EXPECT_EQ(content.groups[0].modes.size(), 1u);
  EXPECT_GT(content.groups[0].probabilities(1), 0.999);
}

// Of a landmark that nobody knows the first sighting may be the false one.
TEST(TreeSlam, AFalseFirstSightingIsForgotten) {
  TreeSlam slam = Standing({}, std::nullopt);
  slam.Correct(ScanOf(0.0, {At("18", -2.0, 3.0)}));
  for (int i = 1; i < 10; ++i) slam.Correct(ScanOf(0.2 * i, {At("18", 4.0, 0.0)}));
  slam.EndRun();
  const MapContent content = slam.Content();
  ASSERT_EQ(content.groups[0].modes.size(), 1u);
  EXPECT_LT((content.groups[0].modes[0].p_map_landmark - Eigen::Vector2d(4.0, 0.0)).norm(), 1e-9);
}

TEST(TreeSlam, AModeRecurs) {
  TreeSlam slam = Standing({}, std::nullopt);
  std::vector<int> modes;
  for (const double y : {0.0, 3.0, 0.0, 3.0, 0.0}) {
    for (int i = 0; i < 8; ++i) {
      const double t = 20.0 * static_cast<double>(modes.size()) + 0.2 * i;
      slam.Correct(ScanOf(t, {At("18", 4.0, y)}));
    }
    const int state = y == 0.0 ? 1 : 2;
    EXPECT_GT(slam.Probabilities(0)(state), 0.999);
    modes.push_back(static_cast<int>(slam.groups()[0].modes.size()));
  }
  EXPECT_EQ(modes, (std::vector<int>{1, 2, 2, 2, 2}));
}

TEST(TreeSlam, RowsSayWhatTheVisitsSaw) {
  TreeSlam slam = Standing({}, OneMode());
  for (int i = 0; i < 8; ++i) slam.Correct(ScanOf(0.2 * i, {At("18", 4.0, 3.0)}));
  const std::vector<VisitEvidence> rows = slam.EndRun();
  ASSERT_EQ(rows.size(), 1u);
  ASSERT_EQ(rows[0].modes.size(), 3u);
  EXPECT_EQ(rows[0].observations, 8);
  EXPECT_EQ(rows[0].modes[2].mode, ModeNumber(2));
  EXPECT_EQ(rows[0].modes[2].log_likelihood, 0.0);
  EXPECT_LT(rows[0].modes[1].log_likelihood, -20.0);
}

// Scans from the begin of a visit until the likeliest leaf has the landmark at a second mode, if it
// moves in view after ten sightings.
int ScansToFollow(const TreeSlamOptions& options) {
  TreeSlam slam = Standing(options, std::nullopt);
  for (int i = 0; i < 10; ++i) slam.Correct(ScanOf(0.2 * i, {At("18", 4.0, 0.0)}));
  for (int i = 1; i < 30; ++i) {
    slam.Correct(ScanOf(2.0 + 0.2 * i, {At("18", 4.0, 3.0)}));
    if (slam.best().beliefs[0].resolved == 2) return i;
  }
  return -1;
}

// T-IV VI-B, figure 2: Π = I in a visit, unless a mode that is found is a child of another one.
TEST(TreeSlam, ALandmarkThatMovesInViewIsFollowedAtOnceAsAChild) {
  EXPECT_EQ(ScansToFollow({.insertion = NewModeInsertion::kChild}), 2);
  EXPECT_GT(ScansToFollow({.insertion = NewModeInsertion::kBackTrack}), 4);
}

// T-IV figure 3: a leaf that takes the landmark for its mode, whatever it sees, adapts to it.
TEST(TreeSlam, OnlyGatedObservationsCorrectUnlessAskedFor) {
  MapContent prior = OneMode();
  prior.groups[0].modes[0].cov_p_map_landmark = Eigen::Matrix2d::Identity() * 0.04;
  prior.covariance = JointCovariance({prior.groups[0].modes[0].cov_p_map_landmark}, {});
  const auto farthest = [&](bool update_ungated) {
    TreeSlam slam = Standing({.update_ungated = update_ungated}, prior);
    slam.Correct(ScanOf(0.0, {At("18", 4.0, 1.5)}));
    double y = 0.0;
    for (const SlamLeaf* leaf : slam.leaves().all()) {
      y = std::max(y, leaf->filter.state().Position(leaf->filter.mode(0, 1).landmark).y());
    }
    return std::pair(y, slam.leaves().size());
  };
  EXPECT_EQ(farthest(false), std::pair(0.0, std::size_t{1}));
  const auto [y, leaves] = farthest(true);
  EXPECT_NEAR(y, 1.5 * 0.04 / (0.04 + kSd * kSd), 1e-9);
  EXPECT_EQ(leaves, 2u);
}

// T-IV V-A: a leaf that took what was seen for another mode may become the likeliest one later.
TEST(TreeSlam, AfterTheVisitAllLeavesHaveTheModeThatWasFound) {
  MapContent prior = OneMode();
  prior.groups[0].modes[0].cov_p_map_landmark = Eigen::Matrix2d::Identity() * 0.04;
  prior.covariance = JointCovariance({prior.groups[0].modes[0].cov_p_map_landmark}, {});
  TreeSlam slam = Standing({.update_ungated = true}, prior);
  for (int i = 0; i < 4; ++i) slam.Correct(ScanOf(0.2 * i, {At("18", 4.0, 1.2)}));
  slam.EndRun();
  ASSERT_EQ(slam.groups()[0].modes.size(), 2u);
  ASSERT_EQ(slam.leaves().size(), 2u);
  for (const SlamLeaf* leaf : slam.leaves().all()) {
    const int landmark = leaf->filter.mode(0, 2).landmark;
    ASSERT_NE(landmark, SlamMap::kNoLandmark);
    EXPECT_LT((leaf->filter.state().Position(landmark) - Eigen::Vector2d(4.0, 1.2)).norm(), 1e-9);
  }
}

// T-IV VII-C: what merging spares.
TEST(TreeSlam, LeavesStayApartWithoutMerging) {
  const auto leaves = [](LeafMerging merging) {
    TreeSlam slam = Standing({.update_ungated = true, .merging = merging}, OneMode());
    for (int i = 0; i < 4; ++i) slam.Correct(ScanOf(0.2 * i, {At("18", 4.0, 0.4)}));
    return slam.leaves().size();
  };
  EXPECT_GT(leaves(LeafMerging::kNone), leaves(LeafMerging::kHeavier));
}

// A vehicle that drives around a circle with landmarks on both sides.
struct Circuit {
  static constexpr int kSteps = 160;
  std::vector<Eigen::Vector2d> landmarks;
  std::mt19937_64 random{7};
  Se2 truth;

  Circuit() {
    for (int i = 0; i < 16; ++i) {
      const double angle = 2.0 * std::numbers::pi * i / 16.0;
      const double radius = 10.0 + (i % 2 == 0 ? 4.0 : -4.0);
      landmarks.emplace_back(radius * std::sin(angle), 10.0 - radius * std::cos(angle));
    }
  }

  MotionIncrement Move() {
    std::normal_distribution<double> normal;
    const Eigen::Vector3d sd(0.02, 0.02, 0.01);
    const double turn = 2.0 * std::numbers::pi / 80.0;
    const Se2 motion = Se2::Exp({10.0 * turn, 0.0, turn});
    truth = truth * motion;
    const Eigen::Vector3d error(normal(random), normal(random), normal(random));
    MotionIncrement increment;
    increment.T_begin_end = motion * Se2::Exp(sd.cwiseProduct(error));
    increment.cov = sd.cwiseAbs2().asDiagonal();
    return increment;
  }

  std::vector<Observation> See(bool named) {
    std::normal_distribution<double> noise(0.0, kSd);
    std::vector<Observation> seen;
    for (std::size_t i = 0; i < landmarks.size(); ++i) {
      const Eigen::Vector2d q = truth.Inverse() * landmarks[i];
      if (q.norm() > 9.0) continue;
      seen.push_back(At(named ? fmt::format("L{:02}", i) : "", q.x(), q.y()));
      seen.back().z += Eigen::Vector2d(noise(random), noise(random));
    }
    return seen;
  }
};

// One signature at two places: a visit that goes on at one of them ends far from the other.
TEST(TreeSlam, AVisitMayEndFarFromAModeThatItFound) {
  TreeSlam slam = Standing({}, std::nullopt);
  MotionIncrement drive;
  drive.T_begin_end = Se2(1.0, 0.0, 0.0);
  drive.cov = Eigen::Vector3d(1e-4, 1e-4, 1e-6).asDiagonal();
  int step = 0;
  const auto move = [&](double direction, int steps, bool tag) {
    drive.T_begin_end = Se2(direction, 0.0, 0.0);
    for (int i = 0; i < steps; ++i, ++step) {
      slam.Predict(drive);
      // Many landmarks, so that those far away are not active.
      std::vector<Observation> seen = {At(fmt::format("L{}", step), 2.0, 3.0)};
      if (tag) seen.push_back(At("18", 4.0 - direction * i, 1.0));
      slam.Correct(ScanOf(0.5 * step, seen));
      if (i % 2 == 0) slam.Correct(ScanOf(0.5 * step + 0.1, seen));
    }
  };
  move(1.0, 6, true);
  move(1.0, 60, false);
  move(1.0, 6, true);
  move(-1.0, 72, false);
  slam.EndRun();
  EXPECT_GE(slam.groups().size(), 60u);
}

// Where nothing moves, the tree is its one EKF.
TEST(TreeSlam, IsPlainEkfSlamInAStaticWorld) {
  for (const SlamState::Errors errors :
       {SlamState::Errors::kPrinted, SlamState::Errors::kInvariant}) {
    Circuit circuit;
    TreeSlam slam = Standing({.gate_probability = 1.0 - 1e-9, .errors = errors}, std::nullopt);
    SlamState plain(TestCalibration(), errors);
    std::map<Signature, int> known;
    for (int step = 0; step < Circuit::kSteps; ++step) {
      if (step > 0) {
        const MotionIncrement motion = circuit.Move();
        slam.Predict(motion);
        plain.Predict(motion);
      }
      const std::vector<Observation> seen = circuit.See(true);
      slam.Correct(ScanOf(0.2 * step, seen));
      for (const Observation& observation : seen) {
        const auto [entry, added] = known.try_emplace(observation.signature, 0);
        if (added) {
          entry->second = plain.Add(observation);
        } else {
          const SlamPair pair{entry->second, &observation};
          plain.Update({&pair, 1});
        }
      }
      const PoseWithCovariance pose = slam.best().filter.Pose();
      EXPECT_LT((plain.pose().Inverse() * pose.T_map_vehicle).Log().norm(), 1e-9);
      EXPECT_LT((plain.PoseCovariance() - pose.cov_T_map_vehicle).norm(), 1e-12);
    }
    slam.EndRun();
    EXPECT_EQ(slam.Content().groups.size(), 16u);
  }
}

TEST(TreeSlam, LandmarksWithoutSignatureAreMappedBesideOthers) {
  for (const AssociationMethod method : {AssociationMethod::kNearest, AssociationMethod::kJoint}) {
    Circuit circuit;
    TreeSlam slam = Standing({.anonymous_landmarks = {.association = method}}, std::nullopt);
    for (int step = 0; step < Circuit::kSteps; ++step) {
      if (step > 0) slam.Predict(circuit.Move());
      std::vector<Observation> seen = circuit.See(false);
      if (step % 4 == 0 && seen.size() > 2) seen[0].signature = {};
      slam.Correct(ScanOf(0.2 * step, seen));
    }
    const MapContent content = slam.Content();
    ASSERT_EQ(content.anonymous_landmarks.size(), circuit.landmarks.size());
    const PoseWithCovariance pose = slam.best().filter.Pose();
    EXPECT_LT(SquaredMahalanobis(pose.T_map_vehicle, circuit.truth, pose.cov_T_map_vehicle), 16.0);
  }
}

// Two places four standard deviations apart.
TEST(TreeSlam, WhatBeginsALandmarkWithoutSignatureIsAnOption) {
  const auto landmarks = [](double isolation_probability) {
    TreeSlam slam = Standing(
        {.anonymous_landmarks = {.isolation_probability = isolation_probability}}, std::nullopt);
    for (int step = 0; step < 10; ++step) {
      slam.Correct(ScanOf(0.2 * step, {At("", 5.0, 0.0), At("", 5.0, 4.0 * kSd)}));
    }
    return slam.Content().anonymous_landmarks.size();
  };
  EXPECT_EQ(landmarks(0.9999), 1u);
  EXPECT_EQ(landmarks(0.9), 2u);
}

// A stored map does not say that the errors of its landmarks without signature are shared.
TEST(TreeSlam, LandmarksWithoutSignatureOfAMapAreNotTakenForIndependent) {
  MapContent prior = OneMode();
  const Eigen::Matrix2d cov = Eigen::Matrix2d::Identity() * 0.04;
  for (int i = 0; i < 20; ++i) {
    Mode mode;
    mode.p_map_landmark = {3.0 + 0.2 * i, i % 2 == 0 ? 2.0 : -2.0};
    mode.cov_p_map_landmark = cov;
    prior.anonymous_landmarks.push_back(mode);
  }
  TreeSlam slam(TreeSlamOptions(), TestCalibration(), prior);
  slam.BeginRun(
      {Se2(), Eigen::Matrix3d::Identity() * 0.2}, TestCalibration(), StampFromSeconds(1000.0));
  for (int i = 0; i < 10; ++i) {
    std::vector<Observation> seen;
    for (const Mode& mode : prior.anonymous_landmarks) {
      seen.push_back(At("", mode.p_map_landmark.x(), mode.p_map_landmark.y()));
    }
    slam.Correct(ScanOf(0.2 * i, seen));
  }
  const Eigen::Matrix3d P = slam.best().filter.Pose().cov_T_map_vehicle;
  EXPECT_GT(P(0, 0), 0.03);  // As one landmark is known, and not 0.04 / 20.
  EXPECT_GT(P(1, 1), 0.03);
}

// The map moves with the pose that the run begins at.
TEST(TreeSlam, DoesNotDependOnTheFrame) {
  const Se2 moved(30.0, -5.0, 2.0);
  std::vector<MapContent> maps;
  for (const Se2& start : {Se2(), moved}) {
    Circuit circuit;
    TreeSlam slam(TreeSlamOptions(), TestCalibration(), std::nullopt);
    slam.BeginRun({start, Eigen::Matrix3d::Zero()}, TestCalibration(), StampFromSeconds(1000.0));
    for (int step = 0; step < 60; ++step) {
      if (step > 0) slam.Predict(circuit.Move());
      slam.Correct(ScanOf(0.2 * step, circuit.See(true)));
    }
    slam.EndRun();
    maps.push_back(slam.Content());
  }
  ASSERT_EQ(maps[0].groups.size(), maps[1].groups.size());
  for (std::size_t g = 0; g < maps[0].groups.size(); ++g) {
    const Eigen::Vector2d expected = moved * maps[0].groups[g].modes[0].p_map_landmark;
    EXPECT_LT((maps[1].groups[g].modes[0].p_map_landmark - expected).norm(), 1e-6);
  }
}

// T-IV (28): x + T v cos θ, and Q along the axes of the map.
TEST(TreeSlam, EulerStepsAreThosePrinted) {
  TreeSlam slam(TreeSlamOptions(), TestCalibration(), std::nullopt);
  const Se2 start(1.0, 2.0, 0.7);
  slam.BeginRun({start, Eigen::Matrix3d::Zero()}, TestCalibration(), StampFromSeconds(1000.0));
  const Eigen::Matrix3d Q = Eigen::Vector3d(0.04, 0.01, 0.02).asDiagonal();
  slam.PredictEuler(2.0, 0.3, 0.5, Q);
  const PoseWithCovariance pose = slam.best().filter.Pose();
  EXPECT_NEAR(pose.T_map_vehicle.x(), 1.0 + 0.5 * 2.0 * std::cos(0.7), 1e-12);
  EXPECT_NEAR(pose.T_map_vehicle.y(), 2.0 + 0.5 * 2.0 * std::sin(0.7), 1e-12);
  EXPECT_NEAR(pose.T_map_vehicle.yaw(), 0.85, 1e-12);
  const Eigen::Matrix2d R = pose.T_map_vehicle.Rotation();
  const Eigen::Matrix2d in_map = R * pose.cov_T_map_vehicle.topLeftCorner<2, 2>() * R.transpose();
  EXPECT_LT((in_map - Q.topLeftCorner<2, 2>()).norm(), 1e-12);
  EXPECT_NEAR(pose.cov_T_map_vehicle(2, 2), 0.02, 1e-12);
}

// Backward along the inverse motions a run maps the same landmarks.
TEST(TreeSlam, ARunMayBeFilteredBackward) {
  Circuit circuit;
  std::vector<MotionIncrement> motions;
  std::vector<Scan> scans = {ScanOf(0.0, circuit.See(true))};
  for (int step = 1; step < 40; ++step) {
    motions.push_back(circuit.Move());
    scans.push_back(ScanOf(0.2 * step, circuit.See(true)));
  }
  TreeSlam slam(TreeSlamOptions(), TestCalibration(), std::nullopt);
  slam.BeginRun({circuit.truth, Eigen::Matrix3d::Identity() * 1e-6},
                TestCalibration(),
                scans.back().stamp,
                TreeSlam::Direction::kBackward);
  std::vector<VisitEvidence> rows;
  for (std::size_t i = scans.size(); i-- > 0;) {
    if (i + 1 < scans.size()) slam.Predict(Inverse(motions[i]));
    const TreeEvents& events = slam.Correct(scans[i]);
    rows.insert(rows.end(), events.evidence.begin(), events.evidence.end());
  }
  for (const VisitEvidence& row : slam.EndRun()) rows.push_back(row);
  const PoseWithCovariance pose = slam.best().filter.Pose();
  EXPECT_LT(SquaredMahalanobis(pose.T_map_vehicle, Se2(), pose.cov_T_map_vehicle), 16.0);
  ASSERT_FALSE(rows.empty());
  for (const VisitEvidence& row : rows) {
    EXPECT_LE(row.begin, row.end);
    EXPECT_GE(row.begin, scans.front().stamp);
    EXPECT_LE(row.end, scans.back().stamp);
  }
  const MapContent content = slam.Content();
  for (const LandmarkGroup& group : content.groups) {
    const auto i = static_cast<std::size_t>(std::stoi(group.signature.text().substr(1)));
    EXPECT_LT((group.modes[0].p_map_landmark - circuit.landmarks[i]).norm(), 0.6);
  }
}

}  // namespace
}  // namespace shiftmap
