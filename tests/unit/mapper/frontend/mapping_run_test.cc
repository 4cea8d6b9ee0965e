// SPDX-License-Identifier: Apache-2.0
#include "mapper/frontend/mapping_run.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace shiftmap {
namespace {

const std::vector<Signature> kSignatures = {Signature("A"), Signature("B"), Signature("C")};

Observation Seen(const std::string& signature, double range_m, double bearing_rad = 0.0) {
  Observation observation;
  observation.signature = Signature(signature);
  observation.z = {range_m, bearing_rad};
  return observation;
}

Scan ScanAt(double seconds, std::vector<Observation> observations) {
  return {StampFromSeconds(seconds), std::move(observations)};
}

Run RunOf(std::vector<Scan> scans) {
  Run run;
  run.odometry.push_back({StampFromSeconds(0.0), 1.0, 0.0});
  run.scans = std::move(scans);
  return run;
}

TEST(MappingRun, AGapStartsAnotherVisit) {
  FrontEndOptions options;
  options.visit_gap_s = 10.0;
  const MappingRun run = MakeMappingRun(RunOf({ScanAt(1.0, {Seen("A", 3.0)}),
                                               ScanAt(11.0, {Seen("A", 3.0), Seen("C", 2.0)}),
                                               ScanAt(21.5, {Seen("A", 3.0)})}),
                                        kSignatures,
                                        options);
  ASSERT_EQ(run.visits.size(), 3u);
  EXPECT_EQ(run.visits[0].group, GroupIndex(0));
  EXPECT_EQ(run.visits[0].begin, StampFromSeconds(1.0));
  EXPECT_EQ(run.visits[0].end, StampFromSeconds(11.0));
  EXPECT_EQ(run.visits[0].sightings.size(), 2u);
  EXPECT_EQ(run.visits[1].group, GroupIndex(2));
  EXPECT_EQ(run.visits[2].group, GroupIndex(0));
  EXPECT_EQ(run.visits[2].begin, StampFromSeconds(21.5));
  for (const VisitIndex v : run.visits.indices()) {
    for (const SightingIndex s : run.visits[v].sightings) EXPECT_EQ(run.sightings[s].visit, v);
  }
}

TEST(MappingRun, OneSignatureAtTwoPlacesIsLeftOutAndCounted) {
  const MappingRun run = MakeMappingRun(
      RunOf({ScanAt(1.0, {Seen("A", 3.0), Seen("A", 6.0), Seen("B", 4.0)})}), kSignatures, {});
  EXPECT_EQ(run.duplicate_observations, 2);
  ASSERT_EQ(run.sightings.size(), 1u);
  EXPECT_EQ(run.sightings[0].observation.signature.text(), "B");
}

TEST(MappingRun, BearingsOfWhatIsTooNearAreLeftOutAndCounted) {
  Observation cartesian = Seen("C", 0.0);
  cartesian.kind = Observation::Kind::kCartesian;
  cartesian.z = {0.1, 0.0};
  const MappingRun run = MakeMappingRun(
      RunOf({ScanAt(1.0, {Seen("A", 0.1), Seen("B", 0.3), cartesian})}), kSignatures, {});
  EXPECT_EQ(run.near_observations, 1);
  ASSERT_EQ(run.sightings.size(), 2u);
  EXPECT_EQ(run.sightings[0].observation.signature.text(), "B");
  EXPECT_EQ(run.sightings[1].observation.signature.text(), "C");
}

TEST(MappingRun, OneSignatureTwiceAtOnePlaceIsOneSighting) {
  const MappingRun run =
      MakeMappingRun(RunOf({ScanAt(1.0, {Seen("A", 3.0), Seen("A", 3.1)})}), kSignatures, {});
  EXPECT_EQ(run.duplicate_observations, 0);
  ASSERT_EQ(run.sightings.size(), 1u);
  EXPECT_EQ(run.sightings[0].observation.z.x(), 3.0);
}

TEST(MappingRun, AnonymousObservationsAreCountedOnly) {
  const MappingRun run = MakeMappingRun(
      RunOf({ScanAt(1.0, {Seen("", 3.0), Seen("", 5.0)}), ScanAt(2.0, {})}), kSignatures, {});
  EXPECT_EQ(run.anonymous_observations, 2);
  EXPECT_TRUE(run.frames.empty());
  EXPECT_EQ(run.scan_stamps.size(), 2u);
}

TEST(MappingRun, ScansOfOneStampAreOneFrame) {
  const MappingRun run = MakeMappingRun(RunOf({ScanAt(1.0, {Seen("A", 3.0)}),
                                               ScanAt(1.0, {Seen("B", 4.0)}),
                                               ScanAt(2.0, {Seen("C", 5.0)})}),
                                        kSignatures,
                                        {});
  ASSERT_EQ(run.frames.size(), 2u);
  EXPECT_EQ(run.frames[0].sighting_count, 2);
  EXPECT_EQ(run.frames[1].first_sighting, SightingIndex(2));
  EXPECT_EQ(run.sightings[1].frame, FrameIndex(0));
  EXPECT_EQ(run.sightings[2].frame, FrameIndex(1));
}

TEST(MappingRun, MeanSquaredBearingIsWeightedBySquaredRange) {
  const MappingRun run = MakeMappingRun(
      RunOf({ScanAt(1.0, {Seen("A", 1.0, 0.5), Seen("B", 2.0, -0.2)})}), kSignatures, {});
  EXPECT_NEAR(run.mean_squared_bearing, (1.0 * 0.25 + 4.0 * 0.04) / 5.0, 1e-12);
}

TEST(MappingRun, CollectsEverySignatureOnce) {
  const auto a = RunOf({ScanAt(1.0, {Seen("B", 3.0), Seen("", 3.0)})});
  const auto b = RunOf({ScanAt(1.0, {Seen("A", 3.0), Seen("B", 3.0)})});
  EXPECT_EQ(CollectSignatures({&a, &b}, {Signature("C"), Signature("A")}), kSignatures);
}

}  // namespace
}  // namespace shiftmap
