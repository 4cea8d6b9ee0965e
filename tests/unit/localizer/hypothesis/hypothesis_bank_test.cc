// SPDX-License-Identifier: Apache-2.0
#include "localizer/hypothesis/hypothesis_bank.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "localizer/hypothesis/log_math.h"
#include "localizer/models/detection_model.h"
#include "localizer/models/site_area.h"
#include "tests/unit/localizer/simulated_run.h"

namespace shiftmap {
namespace {

// One landmark with two modes in front of a vehicle at the origin.
MapContent OneGroup(const Eigen::Vector2d& p1, const Eigen::Vector2d& p2) {
  MapContent content = MakeTwoModeMap(1, 10.0, 1);
  content.groups[0].modes[0].p_map_landmark = p1;
  content.groups[0].modes[1].p_map_landmark = p2;
  return content;
}

PoseWithCovariance AtOrigin(double sd_m) {
  return {Se2(), Eigen::Vector3d(sd_m * sd_m, sd_m * sd_m, 0.0004).asDiagonal()};
}

Scan ScanOf(const MapContent& content, double at_s, const Eigen::Vector2d& z) {
  Scan scan;
  scan.stamp = StampFromSeconds(1000.0 + at_s);
  Observation observation;
  observation.signature = content.groups[0].signature;
  observation.z = z;
  scan.observations.push_back(observation);
  return scan;
}

// Of a vehicle that sees as far as the map says before it has shown so.
HypothesisOptions OfTheMapsView() {
  HypothesisOptions options;
  options.field_of_view.own = false;
  return options;
}

TEST(HypothesisBank, DecidesForTheModeThatIsSeen) {
  const MapContent content = OneGroup({4.0, 0.0}, {4.0, 2.5});
  HypothesisBank bank(Snapshot(content), {}, AtOrigin(0.1), StampFromSeconds(1000.0));
  std::vector<TreeDecision> decisions;
  for (int i = 0; i < 20; ++i) {
    const BankEvents events = bank.Correct(ScanOf(content, 0.3 * i, {4.72, 0.559}));
    decisions.insert(decisions.end(), events.decisions.begin(), events.decisions.end());
  }
  ASSERT_EQ(decisions.size(), 1u);  // Once per visit.
  EXPECT_EQ(decisions[0].decision.mode, ModeNumber(2));
  EXPECT_GT(decisions[0].decision.log_odds, 9.2);
  EXPECT_TRUE(decisions[0].surprising);
  const Eigen::VectorXd p = bank.Probabilities(0);
  EXPECT_GT(p[2], 0.999);
  EXPECT_LT(p[2], 1.0);
  EXPECT_GT(p[1], 0.0);
  const std::vector<VisitEvidence> evidence = bank.EndVisits();
  ASSERT_EQ(evidence.size(), 1u);
  EXPECT_EQ(evidence[0].observations, 20);
  EXPECT_EQ(evidence[0].modes[2].log_likelihood, 0.0);
  EXPECT_LT(evidence[0].modes[1].log_likelihood, -9.0);
}

TEST(HypothesisBank, AVisitEndsAndTheChainRunsOn) {
  MapContent content = OneGroup({4.0, 0.0}, {4.0, 2.5});
  content.groups[0].chain = ModeChain::Uniform(2, 1e-3);
  HypothesisBank bank(Snapshot(content), {}, AtOrigin(0.1), StampFromSeconds(1000.0));
  for (int i = 0; i < 5; ++i) bank.Correct(ScanOf(content, 0.3 * i, {4.0, 0.0}));
  const double decided = bank.Probabilities(0)[1];
  Scan empty;
  empty.stamp = StampFromSeconds(1300.0);
  const BankEvents events = bank.Correct(empty);
  EXPECT_EQ(events.evidence.size(), 1u);
  EXPECT_LT(bank.Probabilities(0)[1], decided - 0.1);
}

// T-IV VIII-A: between the two thresholds what is in view stays, and what is out of view too.
TEST(HypothesisBank, ALandmarkAtTheEdgeOfViewStaysWhereItWas) {
  const MapContent content = OneGroup({4.0, 0.0}, {500.0, 0.0});
  const SensorCalibration& sensor = content.calibration.sensor;
  const HypothesisOptions options = OfTheMapsView();
  HypothesisBank bank(Snapshot(content), options, AtOrigin(0.1), StampFromSeconds(1000.0));
  Scan empty;
  empty.stamp = StampFromSeconds(1000.0);
  double yaw_rad = 0.0;
  const auto turn_to = [&](double wanted_rad) {
    MotionIncrement turn;
    turn.T_begin_end = Se2(0.0, 0.0, wanted_rad - yaw_rad);
    yaw_rad = wanted_rad;
    bank.Predict(turn, 0.0);
  };
  const auto in_view = [&] {
    const auto point = bank.best().filter.PredictPoint({0, 1}, Snapshot(content));
    return bank.field_of_view().Probability(point.q, point.cov_q).own;
  };
  const auto visits_after = [&](double seconds) {
    for (double waited_s = 0.0; waited_s < seconds; waited_s += 1.0) {
      empty.stamp += FromSeconds(1.0);
      bank.Correct(empty);
    }
    return bank.visits().size();
  };
  const double long_s = 3.0 * options.visit_gap_s;
  turn_to(sensor.max_bearing_rad + 0.03);
  ASSERT_GT(in_view(), options.fov_leave);
  ASSERT_LT(in_view(), options.fov_enter);
  EXPECT_EQ(visits_after(long_s), 0u);
  turn_to(sensor.max_bearing_rad - 0.03);
  ASSERT_GT(in_view(), options.fov_enter);
  EXPECT_EQ(visits_after(1.0), 1u);
  turn_to(sensor.max_bearing_rad + 0.03);
  EXPECT_EQ(visits_after(long_s), 1u);
  turn_to(sensor.max_bearing_rad + 0.3);
  ASSERT_LT(in_view(), options.fov_leave);
  EXPECT_EQ(visits_after(long_s), 0u);
}

// T-IV VI-A, for every mode.
TEST(HypothesisBank, ModesShareAFilterUntilAnObservationTellsThemApart) {
  const MapContent content = OneGroup({4.0, 0.0}, {4.0, 1.0});
  HypothesisBank bank(Snapshot(content), OfTheMapsView(), AtOrigin(0.5), StampFromSeconds(1000.0));
  Scan empty;
  empty.stamp = StampFromSeconds(1000.0);
  bank.Correct(empty);
  ASSERT_EQ(bank.visits().size(), 1u);
  EXPECT_EQ(bank.leaves().size(), 1u);
  EXPECT_EQ(bank.best().beliefs.at(0).resolved, GroupBelief::kUnresolved);
  bank.Correct(ScanOf(content, 0.3, {4.0, 0.1}));
  EXPECT_EQ(bank.leaves().size(), 3u);  // Either mode, and neither.
}

// T-IV VI-D: with P_FOV of the lower threshold.
TEST(HypothesisBank, WhatIsSeenOutOfViewCountsAsInView) {
  const auto log_odds = [](double max_bearing_rad) {
    MapContent content = OneGroup({1.5, 3.7}, {500.0, 0.0});
    content.calibration.sensor.max_bearing_rad = max_bearing_rad;
    HypothesisBank bank(Snapshot(content), {}, AtOrigin(0.1), StampFromSeconds(1000.0));
    const Eigen::Vector2d& q = content.groups[0].modes[0].p_map_landmark;
    bank.Correct(ScanOf(content, 0.0, {q.norm(), std::atan2(q.y(), q.x())}));
    EXPECT_EQ(bank.visits().size(), 1u);
    const Eigen::VectorXd p = bank.Probabilities(0);
    return std::log(p[1] / p[0]);
  };
  EXPECT_NEAR(log_odds(0.4) - log_odds(3.1), std::log(HypothesisOptions().fov_leave), 1e-3);
}

TEST(HypothesisBank, SilenceProvesNoMoreThanAnOcclusionAllows) {
  const MapContent content = OneGroup({4.0, 0.0}, {40.0, 40.0});
  HypothesisBank bank(Snapshot(content), OfTheMapsView(), AtOrigin(0.1), StampFromSeconds(1000.0));
  Scan empty;
  for (int i = 0; i < 2000; ++i) {
    empty.stamp = StampFromSeconds(1000.0 + 0.3 * i);
    EXPECT_TRUE(bank.Correct(empty).decisions.empty());
  }
  const std::vector<VisitEvidence> evidence = bank.EndVisits();
  ASSERT_EQ(evidence.size(), 1u);
  const double occluded = content.calibration.sensor.occluded_visit_probability;
  EXPECT_NEAR(evidence[0].modes[1].log_likelihood, std::log(occluded), 1e-6);
  EXPECT_NEAR(evidence[0].modes[0].log_likelihood, 0.0, 1e-6);
}

// Where a landmark is seen from T_map_vehicle.
Observation Sighting(const MapContent& content,
                     std::size_t group,
                     const Eigen::Vector2d& p_map,
                     const Se2& T_map_vehicle) {
  const Eigen::Vector2d q = T_map_vehicle.Inverse() * p_map;
  Observation observation;
  observation.signature = content.groups[group].signature;
  observation.z = {q.norm(), std::atan2(q.y(), q.x())};
  return observation;
}

// A landmark at (7, 0) or (7, 2.5), the first more likely, and two that stand.
MapContent ThreeGroups() {
  MapContent content = MakeTwoModeMap(3, 10.0, 1);
  content.groups[0].modes[0].p_map_landmark = {7.0, 0.0};
  content.groups[0].modes[1].p_map_landmark = {7.0, 2.5};
  content.groups[1].modes[0].p_map_landmark = {8.0, -2.0};
  content.groups[2].modes[0].p_map_landmark = {8.0, -3.5};
  for (std::size_t i = 1; i < 3; ++i) content.groups[i].modes[1].p_map_landmark = {500.0, 0.0};
  return content;
}

// After a drive without sightings a landmark is seen at its less likely mode, alone or with others.
TEST(HypothesisBank, AfterABlindDriveALandmarkAloneDoesNotContradictTheMap) {
  const MapContent content = ThreeGroups();
  for (const bool alone : {true, false}) {
    HypothesisBank bank(Snapshot(content), {}, AtOrigin(0.1), StampFromSeconds(1000.0));
    MotionIncrement blind;
    blind.T_begin_end = Se2(3.0, 0.0, 0.0);
    blind.cov = Eigen::Vector3d(0.01, 0.01, 0.0004).asDiagonal();
    bank.Predict(blind, 10.0);
    std::vector<TreeDecision> of_first;
    for (int i = 0; i < 20; ++i) {
      Scan scan;
      scan.stamp = StampFromSeconds(1010.0 + 0.3 * i);
      scan.observations.push_back(Sighting(content, 0, {7.0, 2.5}, blind.T_begin_end));
      for (std::size_t other = 1; other < 3 && !alone; ++other) {
        const Eigen::Vector2d& p = content.groups[other].modes[0].p_map_landmark;
        scan.observations.push_back(Sighting(content, other, p, blind.T_begin_end));
      }
      for (const TreeDecision& made : bank.Correct(scan).decisions) {
        if (made.decision.signature == content.groups[0].signature) of_first.push_back(made);
      }
    }
    const std::vector<VisitEvidence> evidence = bank.EndVisits();
    const auto of_group = std::find_if(evidence.begin(), evidence.end(), [&](const auto& visit) {
      return visit.signature == content.groups[0].signature;
    });
    ASSERT_NE(of_group, evidence.end());
    if (alone) {
      EXPECT_TRUE(of_first.empty());
      for (const auto& mode : of_group->modes) EXPECT_EQ(mode.log_likelihood, 0.0);
    } else {
      ASSERT_EQ(of_first.size(), 1u);
      EXPECT_EQ(of_first[0].decision.mode, ModeNumber(2));
      EXPECT_LT(of_group->modes[1].log_likelihood, -9.0);
    }
  }
}

// What a vehicle cannot see it does not miss: another landmark shows how far it sees.
TEST(HypothesisBank, SilenceCountsAsFarAsTheVehicleHasSeen) {
  const auto log_odds_after = [](double seen_at_m) {
    MapContent content = MakeTwoModeMap(3, 10.0, 1);
    Scan scan;
    for (LandmarkGroup& group : content.groups) {
      group.modes[0].p_map_landmark = {5.0, 0.0};
      group.modes[1].p_map_landmark = {500.0, 0.0};
    }
    for (const std::size_t seen : {1U, 2U}) {
      const double bearing = seen == 1U ? 0.3 : -0.3;
      const Eigen::Vector2d direction(std::cos(bearing), std::sin(bearing));
      content.groups[seen].modes[0].p_map_landmark = seen_at_m * direction;
      scan.observations.push_back(Sighting(content, seen, seen_at_m * direction, Se2()));
    }
    HypothesisBank bank(Snapshot(content), {}, AtOrigin(0.1), StampFromSeconds(1000.0));
    for (int i = 0; i < 100; ++i) {
      scan.stamp = StampFromSeconds(1000.0 + 0.3 * i);
      bank.Correct(scan);
    }
    const Eigen::VectorXd p = bank.Probabilities(0);
    return std::log(p[1] / p[0]);
  };
  const double prior = std::log(0.9 / 0.02);
  EXPECT_NEAR(log_odds_after(4.0), prior, 1e-3);
  const double occluded = SensorCalibration().occluded_visit_probability;
  EXPECT_NEAR(log_odds_after(7.0), prior + std::log(occluded), 1e-3);
}

// Wheels may begin to slip when a landmark has been in view for long: it has not moved then.
TEST(HypothesisBank, AWheelThatSlipsBesideOneLandmarkDoesNotMoveIt) {
  MapContent content = OneGroup({22.0, 2.0}, {500.0, 0.0});
  content.calibration.sensor.max_range_m = 30.0;
  HypothesisBank bank(Snapshot(content), {}, AtOrigin(0.05), StampFromSeconds(1000.0));
  constexpr double kStep = 0.3;
  Se2 T_map_vehicle;
  for (int i = 0; T_map_vehicle.x() < 18.0; ++i) {
    MotionIncrement motion;
    motion.T_begin_end = Se2(kStep, 0.0, 0.0);
    motion.cov = Eigen::Vector3d(4e-6, 4e-6, 4e-6).asDiagonal();
    bank.Predict(motion, 0.2);
    const bool slips = T_map_vehicle.x() > 8.0 && T_map_vehicle.x() < 14.0;
    T_map_vehicle = T_map_vehicle * Se2((slips ? 0.8 : 1.0) * kStep, 0.0, 0.0);
    Scan scan;
    scan.stamp = StampFromSeconds(1000.0 + 0.2 * (i + 1));
    scan.observations.push_back(
        Sighting(content, 0, content.groups[0].modes[0].p_map_landmark, T_map_vehicle));
    bank.Correct(scan);
  }
  EXPECT_NEAR(bank.Pose().T_map_vehicle.x(), T_map_vehicle.x(), 0.5);
  EXPECT_LT(bank.Probabilities(0)[0], 0.1);
}

// A slip takes off the way along it, and not across.
TEST(HypothesisBank, AfterABlindDriveALandmarkAloneTellsModesApartThatNoSlipConfuses) {
  const auto probability_of_second = [](const Eigen::Vector2d& p2) {
    MapContent content = OneGroup({7.0, 0.0}, p2);
    content.groups[0].probabilities = Eigen::Vector3d(0.02, 0.49, 0.49);
    HypothesisBank bank(Snapshot(content), {}, AtOrigin(0.05), StampFromSeconds(1000.0));
    MotionIncrement blind;
    blind.T_begin_end = Se2(3.0, 0.0, 0.0);
    blind.cov = Eigen::Vector3d(0.01, 0.01, 0.0004).asDiagonal();
    bank.Predict(blind, 10.0);
    const Eigen::Vector2d q = p2 - Eigen::Vector2d(3.0, 0.0);
    for (int i = 0; i < 20; ++i) {
      bank.Correct(ScanOf(content, 10.0 + 0.3 * i, {q.norm(), std::atan2(q.y(), q.x())}));
    }
    return bank.Probabilities(0)[2];
  };
  EXPECT_GT(probability_of_second({7.0, 1.0}), 0.999);
  const double confused = probability_of_second({8.0, 0.0});
  EXPECT_GT(confused, 0.9);
  EXPECT_LT(confused, 0.998);
}

TEST(HypothesisBank, ALandmarkAtNoModeComesOutAbsent) {
  const MapContent content = ThreeGroups();
  HypothesisBank bank(Snapshot(content), {}, AtOrigin(0.1), StampFromSeconds(1000.0));
  std::vector<TreeDecision> decisions;
  MotionIncrement ahead;
  ahead.T_begin_end = Se2(0.05, 0.0, 0.0);
  for (int i = 0; i < 60; ++i) {
    bank.Predict(ahead, 0.3);
    const Se2 T_map_vehicle(0.05 * (i + 1), 0.0, 0.0);
    Scan scan;
    scan.stamp = StampFromSeconds(1000.0 + 0.3 * i);
    scan.observations.push_back(Sighting(content, 0, {6.0, 5.0}, T_map_vehicle));
    for (std::size_t other = 1; other < 3; ++other) {
      const Eigen::Vector2d& p = content.groups[other].modes[0].p_map_landmark;
      scan.observations.push_back(Sighting(content, other, p, T_map_vehicle));
    }
    const BankEvents events = bank.Correct(scan);
    EXPECT_FALSE(events.outcomes[0].gated_any);
    for (const TreeDecision& made : events.decisions) {
      if (made.decision.signature == content.groups[0].signature) decisions.push_back(made);
    }
  }
  ASSERT_FALSE(decisions.empty());
  EXPECT_EQ(decisions[0].decision.mode, kAbsent);
}

// From where a vehicle stands whose pose is vague, a landmark that moved looks as one at its mode
// that was never seen from elsewhere: what both explain alike, seen again, tells nothing more.
TEST(HypothesisBank, RepeatedSightingsDoNotTellAVaguePoseFromALandmarkThatMoved) {
  MapContent content = OneGroup({6.0, 0.0}, {500.0, 0.0});
  const SensorCalibration& sensor = content.calibration.sensor;
  HypothesisBank bank(Snapshot(content), {}, AtOrigin(1.0), StampFromSeconds(1000.0));
  const Eigen::Vector2d seen(6.0, 1.5);
  const auto log_odds = [&] {
    const Eigen::VectorXd p = bank.Probabilities(0);
    return std::log(p[1] / p[0]);
  };
  bank.Correct(ScanOf(content, 0.0, {seen.norm(), std::atan2(seen.y(), seen.x())}));
  // By hand: the innovation, of the pose's variance and little else, against any place of the site.
  const double at_mode =
      0.9 * sensor.detection_probability * std::exp(-0.5 * 1.5 * 1.5) / (2.0 * M_PI);
  const double elsewhere =
      0.02 * (sensor.clutter_density_per_m2 + UnknownPlaceDensity(Snapshot(content)));
  const double first = log_odds();
  EXPECT_NEAR(first, std::log(at_mode / elsewhere), 0.2);
  for (int i = 1; i < 40; ++i) {
    const BankEvents events =
        bank.Correct(ScanOf(content, 0.3 * i, {seen.norm(), std::atan2(seen.y(), seen.x())}));
    EXPECT_TRUE(events.decisions.empty()) << i;
    EXPECT_NEAR(log_odds(), first, 1.0) << i;
  }
}

// A vehicle that stands sees a landmark far from its mode, again and again, and another one at its
// mode, which corrects the pose by a metre. That is no motion: the repetitions prove as little as
// where the pose was right from the start.
TEST(HypothesisBank, ACorrectedPoseHasNotMoved) {
  MapContent content = MakeTwoModeMap(2, 10.0, 1);
  content.groups[0].modes[0].p_map_landmark = {6.0, 0.0};
  content.groups[1].modes[0].p_map_landmark = {6.0, -3.0};
  for (LandmarkGroup& group : content.groups) group.modes[1].p_map_landmark = {500.0, 0.0};
  const auto log_odds = [&](double start_x_m) {
    PoseWithCovariance start = AtOrigin(1.0);
    start.T_map_vehicle = Se2(start_x_m, 0.0, 0.0);
    HypothesisOptions options;
    options.alpha = 1e-30;  // Nothing is given up.
    HypothesisBank bank(Snapshot(content), options, start, StampFromSeconds(1000.0));
    for (int i = 0; i < 12; ++i) {
      const double at_s = 0.3 * i;
      bank.Correct(ScanOf(content, at_s, {std::hypot(4.0, 5.0), std::atan2(5.0, 4.0)}));
      Scan other = ScanOf(content, at_s + 0.1, {std::hypot(6.0, 3.0), std::atan2(-3.0, 6.0)});
      other.observations[0].signature = content.groups[1].signature;
      bank.Correct(other);
    }
    EXPECT_LT(bank.best().filter.T_map_vehicle().translation().norm(), 0.1);
    const Eigen::VectorXd p = bank.Probabilities(0);
    return std::log(p[0] / p[1]);
  };
  EXPECT_NEAR(log_odds(1.0), log_odds(0.0), 1.0);
}

// Two hypotheses by hand: the landmark is at its mode, and each sighting a outlier one; or it is
// at one place that no mode has. Pose and motion are exact, and a bias is the same in all
// sightings, so the place is the mean of the sightings.
TEST(HypothesisBank, SightingsAtOnePlaceWeighAsTwoHypothesesByHand) {
  MapContent content = MakeTwoModeMap(1, 10.0, 1);
  LandmarkGroup& group = content.groups[0];
  group.modes[0].p_map_landmark = {8.0, 0.0};
  group.modes[1].p_map_landmark = {500.0, 0.0};
  group.probabilities = Eigen::Vector3d(0.02, 0.979999, 1e-6);
  SensorCalibration& sensor = content.calibration.sensor;
  sensor.detection_probability = 0.8;
  sensor.max_range_m = 30.0;
  const double variance = sensor.sd_position_m * sensor.sd_position_m;
  HypothesisOptions options = OfTheMapsView();
  options.alpha = 1e-30;  // Nothing is given up.
  const PoseWithCovariance exact{Se2(), Eigen::Matrix3d::Identity() * 1e-12};
  HypothesisBank bank(Snapshot(content), options, exact, StampFromSeconds(1000.0));
  MotionIncrement ahead;
  ahead.T_begin_end = Se2(0.2, 0.0, 0.0);

  const Eigen::Vector2d p_true(8.3, 2.5);
  const double log_false = std::log(sensor.clutter_density_per_m2);
  const double new_density = UnknownPlaceDensity(Snapshot(content));
  const double log_any = std::log(sensor.clutter_density_per_m2 + new_density);
  const double log_miss = std::log(1.0 - sensor.detection_probability);
  const double log_detection = std::log(sensor.detection_probability);
  const auto log_density = [](const Eigen::Vector2d& d, double of) {
    return -std::log(2.0 * M_PI * of) - 0.5 * d.squaredNorm() / of;
  };
  const double log_tail = std::log(0.03) + log_detection;
  std::mt19937_64 random(4);
  std::normal_distribution<double> normal(0.0, sensor.sd_position_m);
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  double mode = std::log(group.probabilities[1]);
  double absent = std::log(group.probabilities[0]);
  double at_place = new_density / (sensor.clutter_density_per_m2 + new_density);
  double missed = 0.0;
  int compared = 0;
  for (int i = 0; i < 10; ++i) {
    const Eigen::Vector2d t(0.2 * (i + 1), 0.0);
    const Eigen::Vector2d p = p_true + Eigen::Vector2d(normal(random), normal(random));
    Scan scan = ScanOf(content, 0.3 * i, p - t);
    scan.observations[0].kind = Observation::Kind::kCartesian;
    bank.Predict(ahead, 0.3);
    bank.Correct(scan);

    const double occluded = sensor.occluded_visit_probability;
    const double miss = LogMissedRun(missed + log_miss, occluded) - LogMissedRun(missed, occluded);
    missed += log_miss;
    constexpr double kOutlier = 36.0 + KnownMapFilter::kBiasShare * KnownMapFilter::kBiasShare;
    const double of_mode = group.modes[0].cov_p_map_landmark(0, 0) + kOutlier * variance;
    const double ungated = LogAdd(
        log_false + miss, log_tail + log_density(p - group.modes[0].p_map_landmark, of_mode));
    mode += ungated;
    if (i == 0) {
      absent += log_any;
    } else {
      const double here =
          std::log(at_place) + log_detection + log_density(p - mean, variance * (1.0 + 1.0 / i));
      const double total = LogAdd(here, std::log1p(-at_place) + log_any);
      at_place = std::exp(here - total);
      const bool from_apart = 0.2 * i > 0.5;
      absent += from_apart ? total : std::min(total, ungated);
    }
    mean += (p - mean) / (i + 1.0);

    const double expected = 1.0 / (1.0 + std::exp(mode - absent));
    // By hand the range scale is known.
    EXPECT_NEAR(bank.Probabilities(0)[0], expected, 2e-3) << i;
    compared += expected > 1e-4 && expected < 0.9999;
  }
  EXPECT_GE(compared, 3);
  EXPECT_GT(bank.Probabilities(0)[0], 0.9999);
}

// One visit: a landmark drawn from the prior, seen from a moving vehicle until the test decides.
// Returns the decided state, or -1.
int DecideOneVisit(const MapContent& content, double alpha, int truth, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  const SensorCalibration& sensor = content.calibration.sensor;
  const PoseWithCovariance start = AtOrigin(0.15);
  Se2 T_map_vehicle = Se2(0.15 * normal(random), 0.15 * normal(random), 0.02 * normal(random));
  const Eigen::Vector2d bias =
      KnownMapFilter::kBiasShare *
      Eigen::Vector2d(sensor.sd_range_m * normal(random), sensor.sd_bearing_rad * normal(random));
  const Mode& mode = content.groups[0].modes[static_cast<std::size_t>(truth) - 1];
  const Eigen::Vector2d p =
      mode.p_map_landmark + 0.05 * Eigen::Vector2d(normal(random), normal(random));
  HypothesisOptions options;
  options.alpha = alpha;
  HypothesisBank bank(Snapshot(content), options, start, StampFromSeconds(1000.0));
  MotionIncrement ahead;
  ahead.T_begin_end = Se2(0.12, 0.0, 0.0);
  for (int i = 0; i < 12; ++i) {
    T_map_vehicle = T_map_vehicle * ahead.T_begin_end;
    bank.Predict(ahead, 0.3);
    const Eigen::Vector2d q = T_map_vehicle.Inverse() * p;
    const Eigen::Vector2d z =
        Eigen::Vector2d(q.norm(), std::atan2(q.y(), q.x())) + bias +
        Eigen::Vector2d(sensor.sd_range_m * normal(random), sensor.sd_bearing_rad * normal(random));
    const BankEvents events = bank.Correct(ScanOf(content, 0.3 * i, z));
    if (!events.decisions.empty()) {
      return static_cast<int>(events.decisions[0].decision.mode.value());
    }
  }
  return -1;
}

TEST(HypothesisBank, WrongDecisionsAreAsRareAsPromised) {
  constexpr double kAlpha = 0.05;
  constexpr int kVisits = 2000;
  // Modes so near each other that a single observation rarely tells them apart.
  MapContent content = OneGroup({5.0, 0.0}, {5.0, 0.6});
  content.groups[0].probabilities = Eigen::Vector3d(0.001, 0.6, 0.399);
  std::mt19937_64 random(3);
  std::bernoulli_distribution first(0.6);
  int decided = 0;
  int wrong = 0;
  for (int i = 0; i < kVisits; ++i) {
    const int truth = first(random) ? 1 : 2;
    const int decision = DecideOneVisit(content, kAlpha, truth, 100 + static_cast<unsigned>(i));
    if (decision < 0) continue;
    ++decided;
    wrong += decision != truth;
  }
  EXPECT_GT(decided, kVisits * 3 / 4);
  EXPECT_LE(wrong, kAlpha * decided);
  EXPECT_GT(wrong, 0);  // Nor does it wait for certainty.
}

// A decision says what is likely enough; it does not take away what speaks against it.
TEST(HypothesisBank, ADecisionIsRevisedByWhatComesAfterIt) {
  const MapContent content = OneGroup({4.0, 0.0}, {4.5, 0.0});
  HypothesisOptions options;
  options.alpha = 0.2;
  HypothesisBank bank(Snapshot(content), options, AtOrigin(0.05), StampFromSeconds(1000.0));
  MotionIncrement turn;  // Another view each time.
  turn.T_begin_end = Se2(0.0, 0.0, 0.06);
  std::vector<TreeDecision> decisions;
  for (int i = 0; i < 12; ++i) {
    bank.Predict(turn, 0.3);
    const double range = i == 0 ? 4.1 : 4.55;
    const BankEvents events = bank.Correct(ScanOf(content, 0.3 * i, {range, -0.06 * (i + 1)}));
    decisions.insert(decisions.end(), events.decisions.begin(), events.decisions.end());
  }
  ASSERT_EQ(decisions.size(), 2u);
  EXPECT_EQ(decisions[0].decision.mode, ModeNumber(1));
  EXPECT_EQ(decisions[1].decision.mode, ModeNumber(2));
  EXPECT_EQ(bank.EndVisits().size(), 1u);
}

// By the covariances of both, 0.38 m are within their 0.95 quantile and 0.5 m within their 0.999.
TEST(HypothesisBank, ALeafStandsForPosesThatItMayBeAt) {
  const Eigen::Vector2d p(4.0, 0.0);
  const MapContent content = OneGroup(p, p + Eigen::Vector2d(0.0, 40.0));
  for (const auto& [y, is_other] : {std::pair(0.38, false), std::pair(0.5, true)}) {
    HypothesisBank bank(Snapshot(content), {}, AtOrigin(0.1), StampFromSeconds(1000.0));
    PoseWithCovariance there = AtOrigin(0.1);
    there.T_map_vehicle = Se2(0.0, y, 0.0);
    EXPECT_EQ(bank.Consider(there), is_other) << y;
  }
}

TEST(HypothesisBank, AnotherPoseIsHeldBesideThePresentOneUntilWhatIsSeenDecides) {
  const Eigen::Vector2d p(4.0, 0.0);
  MapContent content = OneGroup(p, p + Eigen::Vector2d(0.0, 40.0));
  HypothesisBank bank(Snapshot(content), {}, AtOrigin(0.1), StampFromSeconds(1000.0));
  PoseWithCovariance there = AtOrigin(0.1);
  there.T_map_vehicle = Se2(0.0, 3.0, 0.0);
  ASSERT_TRUE(bank.Consider(there));
  EXPECT_FALSE(bank.Consider(there));
  const Eigen::Vector2d p_there = there.T_map_vehicle.translation();
  EXPECT_NEAR(bank.ShareNearer(p_there, Eigen::Vector2d::Zero()), 0.5, 1e-9);
  // Second moment of two poses of equal weight about one of them.
  const PoseWithCovariance pose = bank.Pose();
  EXPECT_NEAR(pose.cov_T_map_vehicle(1, 1), 0.5 * 9.0 + 0.01, 0.01);
  EXPECT_NEAR(pose.cov_T_map_vehicle(0, 0), 0.01, 0.01);

  const Eigen::Vector2d q = there.T_map_vehicle.Inverse() * p;
  for (int i = 0; i < 3; ++i) {
    bank.Correct(ScanOf(content, 0.2 * i, {q.norm(), std::atan2(q.y(), q.x())}));
  }
  EXPECT_GT(bank.ShareNearer(p_there, Eigen::Vector2d::Zero()), 0.99);
  EXPECT_LT((bank.Pose().T_map_vehicle.translation() - p_there).norm(), 0.3);
}

TEST(HypothesisBank, LeavesStayBounded) {
  MapContent content = MakeTwoModeMap(30, 8.0, 9);
  content.calibration.sensor.max_bearing_rad = 3.1;
  HypothesisOptions options;
  options.max_leaves = 8;
  options.alpha = 1e-9;
  HypothesisBank bank(Snapshot(content), options, AtOrigin(0.6), StampFromSeconds(1000.0));
  Scan scan;
  scan.stamp = StampFromSeconds(1000.0);
  for (const LandmarkGroup& group : content.groups) {
    Observation observation;
    observation.signature = group.signature;
    const Eigen::Vector2d& q = group.modes[1].p_map_landmark;
    observation.z = {q.norm(), std::atan2(q.y(), q.x())};
    scan.observations.push_back(observation);
  }
  for (int i = 0; i < 5; ++i) {
    scan.stamp += FromSeconds(0.3);
    bank.Correct(scan);
    EXPECT_LE(bank.leaves().size(), 8u);
  }
  EXPECT_LE(bank.leaves_max(), 8);
  for (int group = 0; group < 30; ++group) EXPECT_GT(bank.Probabilities(group)[2], 0.9);
}

TEST(DetectionModel, SectorHasSharpEdgesForACertainPose) {
  SensorCalibration sensor;
  sensor.max_range_m = 5.0;
  sensor.max_bearing_rad = 0.5;
  const Eigen::Matrix2d certain = Eigen::Matrix2d::Identity() * 1e-8;
  EXPECT_NEAR(SectorFieldOfView({4.9, 0.4}, certain, SectorOf(sensor)), 1.0, 1e-9);
  EXPECT_NEAR(SectorFieldOfView({5.1, 0.4}, certain, SectorOf(sensor)), 0.0, 1e-9);
  EXPECT_NEAR(SectorFieldOfView({4.9, -0.6}, certain, SectorOf(sensor)), 0.0, 1e-9);
  EXPECT_NEAR(SectorFieldOfView({5.0, 0.0}, certain, SectorOf(sensor)), 0.5, 1e-9);
}

}  // namespace
}  // namespace shiftmap
