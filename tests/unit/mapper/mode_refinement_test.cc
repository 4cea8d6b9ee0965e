// SPDX-License-Identifier: Apache-2.0
#include "mapper/mode_refinement.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include "mapper/single_run.h"
#include "tests/unit/mapper/mapper_test_util.h"

namespace shiftmap {
namespace {

// One run of a world whose landmarks stand still.
SimulatedWorld StaticWorld(std::uint64_t seed) {
  OpenWorldOptions options = testing::SmallWorld(seed);
  options.runs = 1;
  options.modes_per_group = 1;
  options.duration_s = 200.0;
  return testing::Simulate(options);
}

std::size_t CountModes(const MapProblem& problem) {
  std::size_t count = 0;
  for (const std::vector<BuildMode>& group : problem.modes) count += group.size();
  return count;
}

// The modes that the visits of a group are assigned to.
std::set<int> AssignedModes(const MapProblem& problem, int group) {
  std::set<int> assigned;
  const std::vector<std::vector<VisitRef>> visits = VisitsByGroup(problem);
  for (const VisitRef& ref : visits[static_cast<std::size_t>(group)]) {
    assigned.insert(problem.runs[0].assignment[static_cast<std::size_t>(ref.visit)]);
  }
  return assigned;
}

Eigen::MatrixXd ModeCovariance(const MapperOptions& options, MapProblem* problem) {
  return ComputeModeCovariance(SolveContinuous(options, problem));
}

TEST(ModeRefinement, LandmarksThatStandStillHaveOneMode) {
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    const SimulatedWorld world = StaticWorld(seed);
    const MappingRun run = testing::Arrange(world, world.runs[0].run);
    const MapProblem problem = MapSingleRun(run, testing::SignaturesOf(world), {});
    for (std::size_t group = 0; group < problem.modes.size(); ++group) {
      EXPECT_LE(problem.modes[group].size(), 1u) << seed << " " << group;
    }
    EXPECT_LT(testing::AlignedRmse(problem.runs[0].poses, testing::TruePoses(world.runs[0], run)),
              0.12)
        << seed;
  }
}

TEST(ModeRefinement, NoiseOfTheSensorIsEstimated) {
  const SimulatedWorld world = StaticWorld(4);
  const MappingRun run = testing::Arrange(world, world.runs[0].run);
  MapperOptions options;
  options.calibration.sensor.sd_range_m = 0.3;
  options.calibration.sensor.sd_bearing_rad = 0.01;
  const MapProblem problem = MapSingleRun(run, testing::SignaturesOf(world), options);
  EXPECT_NEAR(problem.sensor.sd_range_m, 0.1, 0.015);
  EXPECT_NEAR(problem.sensor.sd_bearing_rad, 0.02, 0.004);
}

// A world in which landmark 0 moves at half time to where landmark 1 stands, which is taken away.
SimulatedWorld WorldWithAMover(std::uint64_t seed) {
  SimulatedWorld world = StaticWorld(seed);
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
    const MapProblem problem = MapSingleRun(run, testing::SignaturesOf(world), {});
    ASSERT_EQ(problem.modes[0].size(), 2u) << seed;
    EXPECT_EQ(problem.modes[1].size(), 0u) << seed;
    EXPECT_EQ(AssignedModes(problem, 0), (std::set<int>{0, 1})) << seed;
    const double moved =
        (problem.modes[0][0].p_map_landmark - problem.modes[0][1].p_map_landmark).norm();
    EXPECT_NEAR(moved, (world.groups[0].modes[0] - world.groups[1].modes[0]).norm(), 0.3) << seed;
  }
}

// Visits that no mode explains, though what they make is taken for the mode that is there.
TEST(ModeRefinement, AModeIsNotMadeAndMergedForEver) {
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    const SimulatedWorld world = WorldWithAMover(seed);
    const MappingRun run = testing::Arrange(world, world.runs[0].run);
    MapperOptions options;
    options.modes.position_floor_m = 100.0;
    const MapProblem problem = MapSingleRun(run, testing::SignaturesOf(world), options);
    EXPECT_EQ(problem.modes[0].size(), 1u) << seed;
    EXPECT_LE(problem.modes_merged, 3) << seed;
  }
}

TEST(ModeRefinement, OneMisreadSignatureMakesNoMode) {
  SimulatedWorld world = StaticWorld(2);
  const MappingRun clean = testing::Arrange(world, world.runs[0].run);
  const MapProblem expected = MapSingleRun(clean, testing::SignaturesOf(world), {});
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
  const MapProblem problem = MapSingleRun(run, testing::SignaturesOf(world), {});
  EXPECT_EQ(CountModes(problem), CountModes(expected));
}

TEST(ModeRefinement, MergesModesThatAreOnePlace) {
  const SimulatedWorld world = StaticWorld(1);
  const MappingRun run = testing::Arrange(world, world.runs[0].run);
  const MapperOptions options;
  MapProblem problem = MapSingleRun(run, testing::SignaturesOf(world), options);
  const std::vector<std::vector<VisitRef>> visits = VisitsByGroup(problem);
  const auto busiest =
      std::max_element(visits.begin(), visits.end(), [](const auto& a, const auto& b) {
        return a.size() < b.size();
      });
  ASSERT_GE(busiest->size(), 2u);
  const auto group = static_cast<std::size_t>(busiest - visits.begin());
  ASSERT_EQ(problem.modes[group].size(), 1u);
  const std::size_t before = CountModes(problem);
  problem.modes[group].push_back(problem.modes[group].front());
  problem.runs[0].assignment[static_cast<std::size_t>(busiest->back().visit)] = 1;
  const ModeDifferences differences(ModeCovariance(options, &problem));
  EXPECT_EQ(MergeModes(options.modes, differences, &problem), 1);
  EXPECT_EQ(CountModes(problem), before);
  EXPECT_EQ(AssignedModes(problem, static_cast<int>(group)), std::set<int>{0});
}

TEST(ModeRefinement, ModesOfThePriorMapStayThoughNothingHoldsThere) {
  const SimulatedWorld world = StaticWorld(1);
  const MappingRun run = testing::Arrange(world, world.runs[0].run);
  MapProblem problem = MapSingleRun(run, testing::SignaturesOf(world), {});
  const std::size_t before = CountModes(problem);
  problem.modes[0].push_back({Eigen::Vector2d(50.0, 50.0), ModeNumber(7)});
  problem.modes[1].push_back({Eigen::Vector2d(50.0, 50.0), kAbsent});
  DropUnusedModes(&problem);
  EXPECT_EQ(CountModes(problem), before + 1);
  EXPECT_EQ(problem.modes[0].back().number, ModeNumber(7));
}

TEST(ModeRefinement, DroppingAModeKeepsThePriorsIndicesRight) {
  MapProblem problem;
  problem.signatures = {Signature("A"), Signature("B")};
  problem.modes = {{{Eigen::Vector2d::Zero(), kAbsent}, {Eigen::Vector2d::Ones(), ModeNumber(1)}},
                   {{Eigen::Vector2d::Ones(), ModeNumber(1)}}};
  problem.prior.modes = {1, 2};
  DropUnusedModes(&problem);
  EXPECT_EQ(problem.prior.modes, (std::vector<int>{0, 1}));
  EXPECT_EQ(CountModes(problem), 2u);
}

TEST(ModeRefinement, VisitsThatNoModeExplainsAreAbsent) {
  const SimulatedWorld world = StaticWorld(3);
  const MappingRun run = testing::Arrange(world, world.runs[0].run);
  const MapperOptions options;
  MapProblem problem = MapSingleRun(run, testing::SignaturesOf(world), options);
  const std::vector<VisitRef> visits = VisitsByGroup(problem)[0];
  ASSERT_FALSE(visits.empty());
  const Eigen::VectorXd here = VisitLogLikelihood(problem, visits[0], options.modes);
  EXPECT_GT(here[1], here[0]);
  problem.modes[0][0].p_map_landmark += Eigen::Vector2d(5.0, 5.0);
  const Eigen::VectorXd away = VisitLogLikelihood(problem, visits[0], options.modes);
  EXPECT_LT(away[1], away[0]);
  EXPECT_GT(SelectModes(options.modes, &problem), 0);
  EXPECT_EQ(AssignedModes(problem, 0), std::set<int>{kUnassigned});
  // They agree on a place, so they make a mode again.
  EXPECT_EQ(CreateModes(options.modes, &problem), 1);
}

}  // namespace
}  // namespace shiftmap
