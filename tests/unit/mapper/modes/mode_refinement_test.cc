// SPDX-License-Identifier: Apache-2.0
#include "mapper/modes/mode_refinement.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "mapper/run_maps/single_run.h"
#include "tests/unit/mapper/mapper_test_util.h"

namespace shiftmap {
namespace {

// The modes that the visits of a group are assigned to.
std::set<OptionalMode> AssignedModes(const BuildState& build, GroupIndex group) {
  std::set<OptionalMode> assigned;
  const auto visits = VisitsByGroup(build);
  for (const VisitRef& ref : visits[group]) assigned.insert(AssignmentOf(build, ref));
  return assigned;
}

TEST(ModeRefinement, LandmarksThatStandStillHaveOneMode) {
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    const SimulatedWorld world = testing::StaticWorld(seed);
    const MappingRun run = testing::Arrange(world, world.runs[0].run);
    const BuildState build = MapSingleRun(run, world.groups.size(), {});
    for (const auto& modes : build.modes) EXPECT_LE(modes.size(), 1u) << seed;
    EXPECT_LT(testing::AlignedRmse(build.runs[0].poses, testing::TruePoses(world.runs[0], run)),
              0.12)
        << seed;
  }
}

TEST(ModeRefinement, NoiseOfTheSensorIsEstimated) {
  const SimulatedWorld world = testing::StaticWorld(4);
  const MappingRun run = testing::Arrange(world, world.runs[0].run);
  MapperOptions options;
  options.calibration.sensor.sd_range_m = 0.3;
  options.calibration.sensor.sd_bearing_rad = 0.01;
  const BuildState build = MapSingleRun(run, world.groups.size(), options);
  EXPECT_NEAR(build.sensor.sd_range_m, 0.1, 0.015);
  EXPECT_NEAR(build.sensor.sd_bearing_rad, 0.02, 0.004);
}

// A world in which landmark 0 moves at half time to where landmark 1 stands, which is taken away.
SimulatedWorld WorldWithAMover(std::uint64_t seed) {
  SimulatedWorld world = testing::StaticWorld(seed);
  const Signature mover = world.groups[0].signature;
  const Signature place = world.groups[1].signature;
  std::vector<Scan>& scans = world.runs[0].run.scans;
  for (std::size_t i = 0; i < scans.size(); ++i) {
    std::vector<Observation>& seen = scans[i].observations;
    const Signature& gone = 2 * i < scans.size() ? place : mover;
    std::erase_if(seen, [&](const Observation& item) { return item.signature == gone; });
    for (Observation& item : seen) {
      if (item.signature == place) item.signature = mover;
    }
  }
  return world;
}

TEST(ModeRefinement, ALandmarkThatMovesInsideARunGetsTwoModes) {
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    const SimulatedWorld world = WorldWithAMover(seed);
    const MappingRun run = testing::Arrange(world, world.runs[0].run);
    const BuildState build = MapSingleRun(run, world.groups.size(), {});
    ASSERT_EQ(build.modes[0].size(), 2u) << seed;
    EXPECT_EQ(build.modes[1].size(), 0u) << seed;
    EXPECT_EQ(AssignedModes(build, 0),
              (std::set<OptionalMode>{GroupModeIndex(0), GroupModeIndex(1)}))
        << seed;
    const double moved =
        (build.modes[0][0].p_map_landmark - build.modes[0][1].p_map_landmark).norm();
    EXPECT_NEAR(moved, (world.groups[0].modes[0] - world.groups[1].modes[0]).norm(), 0.3) << seed;
  }
}

// Landmarks 0 to 2 are doors: every 200 s each goes to its other place and back, 0.8 m away.
constexpr double kDoorM = 0.8;
constexpr int kDoors = 3;

SimulatedWorld WorldWithDoors(std::uint64_t seed) {
  OpenWorldOptions options = testing::SmallWorld(seed);
  options.groups = 16;
  options.modes_per_group = 1;
  options.size_m = 24.0;
  options.runs = 1;
  options.duration_s = 900.0;
  SimulatedWorld world = testing::Simulate(options);
  SimulatedRun& simulated = world.runs[0];
  auto at = simulated.truth.begin();
  for (Scan& scan : simulated.run.scans) {
    while (at->stamp < scan.stamp) ++at;
    const double elapsed_s = ToSeconds(scan.stamp - simulated.truth.front().stamp);
    for (Observation& seen : scan.observations) {
      for (int door = 0; door < kDoors; ++door) {
        const SimulatedGroup& group = world.groups[static_cast<std::size_t>(door)];
        const bool open = static_cast<int>(elapsed_s / 200.0 + 0.3 * door) % 2 == 1;
        if (seen.signature != group.signature || !open) continue;
        const Se2 T_vehicle_map = at->T_map_vehicle.Inverse();
        const Eigen::Vector2d closed_at = T_vehicle_map * group.modes[0];
        const Eigen::Vector2d open_at =
            T_vehicle_map * Eigen::Vector2d(group.modes[0] + Eigen::Vector2d(kDoorM, 0.0));
        seen.z.x() += open_at.norm() - closed_at.norm();
        seen.z.y() +=
            std::atan2(open_at.y(), open_at.x()) - std::atan2(closed_at.y(), closed_at.x());
      }
    }
  }
  return world;
}

// One mode in the middle explains visits at both places so well that none of them is absent.
TEST(ModeRefinement, ADoorWhosePlacesAreNearHasTwoModes) {
  int right = 0;
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    const StatusOr<MapperResult> result =
        BuildMap(testing::Inputs(WorldWithDoors(seed)), std::nullopt, MapperOptions());
    ASSERT_TRUE(result.ok()) << Message(result.status());
    const std::vector<LandmarkGroup>& groups = result->content.groups;
    for (std::size_t g = 0; g < groups.size(); ++g) {
      const std::vector<Mode>& modes = groups[g].modes;
      if (g >= kDoors) {
        EXPECT_EQ(modes.size(), 1u) << "seed " << seed << ", " << g;
      } else if (modes.size() == 2) {
        const double apart = (modes[1].p_map_landmark - modes[0].p_map_landmark).norm();
        right += std::abs(apart - kDoorM) < 0.1;
      }
    }
  }
  EXPECT_GE(right, 10);  // Of 15; some are passed too seldom to tell.
}

// Visits that no mode explains, though what they make is taken for the mode that is there.
TEST(ModeRefinement, AModeIsNotMadeAndMergedForEver) {
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    const SimulatedWorld world = WorldWithAMover(seed);
    const MappingRun run = testing::Arrange(world, world.runs[0].run);
    MapperOptions options;
    options.modes.position_floor_m = 100.0;
    const BuildState build = MapSingleRun(run, world.groups.size(), options);
    EXPECT_EQ(build.modes[0].size(), 1u) << seed;
    EXPECT_LE(build.modes_merged, 3) << seed;
  }
}

TEST(ModeRefinement, OneMisreadSignatureMakesNoMode) {
  SimulatedWorld world = testing::StaticWorld(2);
  const MappingRun clean = testing::Arrange(world, world.runs[0].run);
  const BuildState expected = MapSingleRun(clean, world.groups.size(), {});
  // Once in a visit, once in a scan by itself: the name of a landmark that is elsewhere.
  Observation misread;
  misread.z = {2.0, 0.7};
  std::vector<Scan>& scans = world.runs[0].run.scans;
  for (const std::size_t at : {scans.size() / 3, scans.size() / 2}) {
    for (const SimulatedGroup& group : world.groups) {
      const bool seen = std::any_of(
          scans[at].observations.begin(), scans[at].observations.end(), [&](const auto& item) {
            return item.signature == group.signature;
          });
      if (seen) continue;
      misread.signature = group.signature;
      break;
    }
    scans[at].observations.push_back(misread);
  }
  const MappingRun run = testing::Arrange(world, world.runs[0].run);
  ASSERT_EQ(run.sightings.size(), clean.sightings.size() + 2);
  const BuildState build = MapSingleRun(run, world.groups.size(), {});
  EXPECT_EQ(testing::CountModes(build), testing::CountModes(expected));
}

// Two modes at one place: nothing but what was known before tells them apart.
TEST(ModeRefinement, SelectionStartsFromWhatThePriorMapKnew) {
  const SimulatedWorld world = testing::StaticWorld(3);
  const MappingRun run = testing::Arrange(world, world.runs[0].run);
  MapperOptions options;
  BuildState build = MapSingleRun(run, world.groups.size(), options);
  build.modes[0] = {{build.modes[0][0].p_map_landmark, ModeNumber(4)},
                    {build.modes[0][0].p_map_landmark, ModeNumber(7)}};
  build.known.resize(build.modes.size());
  LandmarkGroup& known = build.known[0].emplace();
  known.chain = ModeChain::Uniform(2, 1e-6);
  known.modes.resize(2);
  known.modes[0].number = ModeNumber(4);
  known.modes[1].number = ModeNumber(7);
  const std::vector<VisitRef> visits = VisitsByGroup(build)[0];
  const Stamp begin = VisitOf(build, visits[0]).begin;
  build.known_at = begin - FromSeconds(3600.0);
  for (const int likely : {1, 2}) {
    known.probabilities = Eigen::Vector3d(0.1, 0.1, 0.1);
    known.probabilities(likely) = 0.8;
    for (const SelectorKind kind : {SelectorKind::kViterbi, SelectorKind::kEm}) {
      options.modes.selector.kind = kind;
      SelectModes(options.modes, &build);
      EXPECT_EQ(AssignedModes(build, 0), std::set<OptionalMode>{ModeOfState(likely)});
    }
    const ModeSequenceProblem sequence = MakeGroupSequence(build, visits, 0, options.modes);
    const double relaxed = std::exp(-1.5e-6 * 3600.0);
    const double stated = 0.8 * (1.0 - kMistakeProbability) + kMistakeProbability / 3.0;
    EXPECT_NEAR(
        std::exp(sequence.log_initial(likely)), 1.0 / 3.0 + (stated - 1.0 / 3.0) * relaxed, 1e-12);
  }
  build.known_at = begin + FromSeconds(1.0);  // The run is older.
  const ModeSequenceProblem older = MakeGroupSequence(build, visits, 0, options.modes);
  EXPECT_NEAR(std::exp(older.log_initial(2)), 1.0 / 3.0, 1e-12);
}

TEST(ModeRefinement, VisitsThatNoModeExplainsAreAbsent) {
  const SimulatedWorld world = testing::StaticWorld(3);
  const MappingRun run = testing::Arrange(world, world.runs[0].run);
  const MapperOptions options;
  BuildState build = MapSingleRun(run, world.groups.size(), options);
  const std::vector<VisitRef> visits = VisitsByGroup(build)[0];
  ASSERT_FALSE(visits.empty());
  const Eigen::VectorXd here = VisitLogLikelihood(build, visits[0], options.modes);
  EXPECT_GT(here[1], here[0]);
  build.modes[0][0].p_map_landmark += Eigen::Vector2d(5.0, 5.0);
  const Eigen::VectorXd away = VisitLogLikelihood(build, visits[0], options.modes);
  EXPECT_LT(away[1], away[0]);
  EXPECT_GT(SelectModes(options.modes, &build), 0);
  EXPECT_EQ(AssignedModes(build, 0), std::set<OptionalMode>{kUnassigned});
  // They agree on a place, so they make a mode again.
  EXPECT_EQ(CreateModes(options.modes, &build), 1);
}

// The score of a visit does not grow with the number of its sightings once runs are placed: a mode
// 0.3 m away is at three standard deviations of their shared error.
TEST(ModeRefinement, SightingsOfAVisitShareTheErrorOfPoseAndMap) {
  const SimulatedWorld world = testing::StaticWorld(3);
  const MappingRun run = testing::Arrange(world, world.runs[0].run);
  const ModeOptions options;
  BuildState build = MapSingleRun(run, world.groups.size(), {});
  build.loss_reach = 50.0;
  const auto visits = VisitsByGroup(build);
  int checked = 0;
  for (const GroupIndex group : build.modes.indices()) {
    if (build.modes[group].empty()) continue;
    BuildMode away = build.modes[group][0];
    away.p_map_landmark += Eigen::Vector2d(0.24, 0.18);
    build.modes[group] = {build.modes[group][0], away};
    for (const VisitRef& ref : visits[group]) {
      if (VisitOf(build, ref).sightings.size() < 10) continue;
      const Eigen::VectorXd score = VisitLogLikelihood(build, ref, options);
      EXPECT_NEAR(score[1] - score[2], 4.5, 3.0) << group.value();
      EXPECT_GT(score[2], score[0]) << group.value();
      ++checked;
    }
  }
  EXPECT_GT(checked, 5);
}

}  // namespace
}  // namespace shiftmap
