// SPDX-License-Identifier: Apache-2.0
#include "mapper/association/anonymous_tracks.h"

#include <gtest/gtest.h>

#include "mapper/association/track_names.h"
#include "tests/unit/mapper/association/anonymous_world.h"
#include "tests/unit/mapper/mapper_test_util.h"

namespace shiftmap {
namespace {

OpenWorldOptions Park(std::uint64_t seed) {
  OpenWorldOptions options;
  options.seed = seed;
  options.groups = 40;
  options.modes_per_group = 1;
  options.size_m = 40.0;
  options.mode_gap_m = 2.0;
  options.runs = 1;
  options.duration_s = 200.0;
  options.mode_change_probability = 0.0;
  return options;
}

Calibration CalibrationOf(const OpenWorldOptions& world) {
  Calibration calibration{world.odometry, world.sensor};
  calibration.odometry.sd_log_scale = 0.02;
  return calibration;
}

TEST(AnonymousTracks, FindTheLandmarks) {
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    const OpenWorldOptions options = Park(seed);
    const SimulatedWorld world = testing::Simulate(options);
    const testing::AnonymousRun run = testing::Anonymize(world.runs[0].run, {}, 0.0, seed);
    const AnonymousAssociation found = AssociateAnonymous(run.run, CalibrationOf(options), {});
    const testing::AssociationScore score = testing::Score(run, found, {});
    EXPECT_GT(score.precision, 0.99) << seed;
    EXPECT_GT(score.recall, 0.95) << seed;
    EXPECT_NEAR(score.tracks, score.landmarks, 2) << seed;
    EXPECT_EQ(found.trajectory.size(), run.run.scans.size());
  }
}

TEST(AnonymousTracks, ClutterMakesHardlyAny) {
  const OpenWorldOptions options = Park(5);
  const SimulatedWorld world = testing::Simulate(options);
  const testing::AnonymousRun run = testing::Anonymize(world.runs[0].run, {}, 1.0, 5);
  const AnonymousAssociation found = AssociateAnonymous(run.run, CalibrationOf(options), {});
  const testing::AssociationScore score = testing::Score(run, found, {});
  EXPECT_GT(score.precision, 0.95);
  EXPECT_GT(score.recall, 0.9);
  EXPECT_NEAR(score.tracks, score.landmarks, 4);
  EXPECT_GT(found.dropped_tracks, 20);
}

// As of points of a lidar that no second scan finds again.
TEST(AnonymousTracks, MostlyClutterNamesNone) {
  const OpenWorldOptions options = Park(5);
  const SimulatedWorld world = testing::Simulate(options);
  for (const double clutter_per_scan : {1.0, 20.0}) {
    const shiftmap::Run run = testing::Anonymize(world.runs[0].run, {}, clutter_per_scan, 5).run;
    for (const double share : {AssociationOptions().min_associated_share, 0.0}) {
      AssociationOptions association;
      association.min_associated_share = share;
      shiftmap::Run named = run;
      ASSERT_TRUE(NameTracks(0, CalibrationOf(options), association, {}, {}, &named).ok());
      const std::vector<Signature> signatures = CollectSignatures({&named}, {});
      EXPECT_EQ(signatures.empty(), clutter_per_scan > 1.0 && share > 0.0) << clutter_per_scan;
    }
  }
}

// Rare scans and bad odometry among many landmarks: the nearest is often another one.
TEST(AnonymousTracks, JointCompatibilityHoldsWhereNearestNeighboursDoNot) {
  testing::AssociationScore joint;
  testing::AssociationScore nearest;
  constexpr int kWorlds = 4;
  for (std::uint64_t seed = 1; seed <= kWorlds; ++seed) {
    OpenWorldOptions options = Park(seed);
    options.groups = 80;
    options.mode_gap_m = 1.0;
    options.duration_s = 300.0;
    options.scan_rate_hz = 1.0;
    options.odometry.noise_v = 0.25;
    options.odometry.noise_omega = 0.12;
    const SimulatedWorld world = testing::Simulate(options);
    const testing::AnonymousRun run = testing::Anonymize(world.runs[0].run, {}, 0.0, seed);
    AssociationOptions association;
    association.confirm_sightings = 2;
    association.confirm_within_scans = 30;
    association.min_sightings = 3;
    association.separation_m = 0.5;
    for (const bool jointly : {false, true}) {
      association.joint = jointly;
      const testing::AssociationScore score = testing::Score(
          run, AssociateAnonymous(run.run, CalibrationOf(options), association), association);
      testing::AssociationScore& mean = jointly ? joint : nearest;
      mean.precision += score.precision / kWorlds;
      mean.recall += score.recall / kWorlds;
    }
  }
  RecordProperty("precision_joint", std::to_string(joint.precision));
  RecordProperty("recall_joint", std::to_string(joint.recall));
  RecordProperty("precision_nearest", std::to_string(nearest.precision));
  RecordProperty("recall_nearest", std::to_string(nearest.recall));
  EXPECT_GT(joint.precision, 0.85);
  EXPECT_GT(joint.precision, nearest.precision + 0.15);
  EXPECT_GT(joint.recall, nearest.recall + 0.15);
}

TEST(AnonymousTracks, SignaturesHoldThePoseForThem) {
  const OpenWorldOptions options = Park(7);
  const SimulatedWorld world = testing::Simulate(options);
  const std::vector<Signature> all = testing::SignaturesOf(world);
  const std::vector<Signature> keep(all.begin(), all.begin() + 10);
  const testing::AnonymousRun run = testing::Anonymize(world.runs[0].run, keep, 0.2, 7);
  const AnonymousAssociation found = AssociateAnonymous(run.run, CalibrationOf(options), {});
  const testing::AssociationScore score = testing::Score(run, found, {});
  EXPECT_GT(score.precision, 0.98);
  EXPECT_NEAR(score.tracks, score.landmarks, 2);
  for (std::size_t i = 0; i < run.run.scans.size(); ++i) {
    for (std::size_t j = 0; j < run.run.scans[i].observations.size(); ++j) {
      if (run.run.scans[i].observations[j].signature.anonymous()) continue;
      EXPECT_EQ(found.track_of[i][j], -1);
    }
  }
}

TEST(AnonymousTracks, SameInputSameTracks) {
  const OpenWorldOptions options = Park(2);
  const SimulatedWorld world = testing::Simulate(options);
  const testing::AnonymousRun run = testing::Anonymize(world.runs[0].run, {}, 0.5, 2);
  const AnonymousAssociation a = AssociateAnonymous(run.run, CalibrationOf(options), {});
  const AnonymousAssociation b = AssociateAnonymous(run.run, CalibrationOf(options), {});
  EXPECT_EQ(a.track_of, b.track_of);
  EXPECT_EQ(a.tracks.front(), b.tracks.front());
}

// A camera that reads the depth, which its calibration says.
TEST(AnonymousTracks, WhatTheSensorGetsWrongIsTakenOff) {
  const OpenWorldOptions options = Park(2);
  const SimulatedWorld world = testing::Simulate(options);
  testing::AnonymousRun run = testing::Anonymize(world.runs[0].run, {}, 0.0, 2);
  Calibration calibration = CalibrationOf(options);
  calibration.sensor.range_curvature_per_rad2 = -0.5;
  calibration.sensor.mean_squared_bearing_rad2 = 0.25;
  for (Scan& scan : run.run.scans) {
    for (Observation& observation : scan.observations) {
      observation.z.x() *= 1.0 - 0.5 * (observation.z.y() * observation.z.y() - 0.25);
    }
  }
  const testing::AssociationScore score =
      testing::Score(run, AssociateAnonymous(run.run, calibration, {}), {});
  EXPECT_GT(score.recall, 0.95);
  EXPECT_NEAR(score.tracks, score.landmarks, 2);
}

TEST(AnonymousTracks, NoScansNoTracks) {
  shiftmap::Run run;
  run.odometry.push_back({});
  EXPECT_TRUE(AssociateAnonymous(run, {}, {}).tracks.empty());
}

TEST(AnonymousTracks, OptionsAreChecked) {
  EXPECT_TRUE(AssociationOptions().Validate().ok());
  EXPECT_FALSE(AssociationOptions{.isolation_probability = 1.0}.Validate().ok());
  EXPECT_FALSE(AssociationOptions{.compatibility = {.max_nodes = 0}}.Validate().ok());
  EXPECT_FALSE(AssociationOptions{.confirm_sightings = 0}.Validate().ok());
  EXPECT_FALSE(AssociationOptions{.duplicate_distance_m = -1.0}.Validate().ok());
  EXPECT_FALSE(AssociationOptions{.min_associated_share = 1.5}.Validate().ok());
}

TEST(TrackNames, AreToldFromSignatures) {
  EXPECT_TRUE(IsTrackSignature(TrackSignature(3, 14)));
  EXPECT_LT(TrackSignature(0, 9), TrackSignature(0, 10));
  EXPECT_LT(TrackSignature(0, 99), TrackSignature(1, 0));
  EXPECT_FALSE(IsTrackSignature(Signature("18")));
  shiftmap::Run run;
  run.odometry.push_back({});
  Observation observation;
  observation.signature = Signature("anon:1");
  observation.z = {2.0, 0.0};
  run.scans.push_back({{}, {observation}});
  const Status status = NameTracks(0, {}, {}, {}, {}, &run);
  EXPECT_EQ(status.code(), StatusCode::kInvalidArgument);
  EXPECT_NE(Message(status).find("anon:1"), std::string::npos);
}

}  // namespace
}  // namespace shiftmap
