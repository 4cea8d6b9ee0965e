// SPDX-License-Identifier: Apache-2.0
#include "mapper/registration/misfit_runs.h"

#include <gtest/gtest.h>

#include <cmath>
#include <deque>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "mapper/mapper.h"
#include "mapper/run_maps/run_map.h"
#include "mapper/run_maps/single_run.h"
#include "mapstore/run/trajectory.h"
#include "tests/unit/mapper/mapper_test_util.h"

namespace shiftmap {
namespace {

// How a landmark of the second run is displaced. [m]
using Displacement = std::function<Eigen::Vector2d(int group)>;

Eigen::Vector2d Nowhere(int /*group*/) { return Eigen::Vector2d::Zero(); }

// Every third landmark by 0.8 m, each in a direction of its own.
Eigen::Vector2d EveryThird(int group) {
  if (group % 3 != 0) return Eigen::Vector2d::Zero();
  return 0.8 * Eigen::Vector2d(std::cos(2.0 * group), std::sin(2.0 * group));
}

class MisfitRuns : public ::testing::Test {
 protected:
  // Two runs among landmarks that stand still, of which the second run sees some elsewhere. All
  // are joined as if they had stayed.
  BuildState JoinedByForce(std::uint64_t seed, const Displacement& displacement) {
    OpenWorldOptions options = testing::SmallWorld(seed);
    options.modes_per_group = 1;
    options.runs = 2;
    const SimulatedWorld world = testing::Simulate(options);
    BuildState joined = MapAlone(world, 0, Nowhere);
    BuildState second = MapAlone(world, 1, displacement);
    std::vector<PointPair> pairs;
    for (const GroupIndex group : joined.modes.indices()) {
      if (joined.modes[group].empty() || second.modes[group].empty()) continue;
      pairs.push_back(
          {joined.modes[group].front().p_map_landmark, second.modes[group].front().p_map_landmark});
    }
    MoveBuild(AlignRigid2d(pairs).value(), &second);
    BuildRun& run = second.runs.front();
    for (const VisitIndex v : run.assignment.indices()) {
      const GroupIndex group = run.data->visits[v].group;
      if (!run.assignment[v]) continue;
      if (joined.modes[group].empty()) joined.modes[group] = {second.modes[group].front()};
      run.assignment[v] = GroupModeIndex(0);
    }
    joined.runs.push_back(std::move(run));
    SolveContinuous(options_, &joined);
    return joined;
  }

  MapperOptions options_;
  std::deque<MappingRun> data_;

 private:
  BuildState MapAlone(const SimulatedWorld& world,
                      std::size_t run,
                      const Displacement& displacement) {
    MappingRun& data = data_.emplace_back(testing::Arrange(world, world.runs[run].run));
    data.name = "run-" + std::to_string(run);
    const IndexedVector<FrameIndex, Se2> poses = testing::TruePoses(world.runs[run], data);
    for (Sighting& sighting : data.sightings) {
      const int group = data.visits[sighting.visit].group.value();
      const Se2& pose = poses[sighting.frame];
      Observation& observation = sighting.observation;
      const Eigen::Vector2d p_map = pose * observation.PositionInVehicle() + displacement(group);
      const Eigen::Vector2d p_vehicle = pose.Inverse() * p_map;
      observation.z = {p_vehicle.norm(), std::atan2(p_vehicle.y(), p_vehicle.x())};
    }
    return MapSingleRun(data, world.groups.size(), options_);
  }
};

TEST_F(MisfitRuns, ARunThatIsJoinedRightFitsAsItDoesByItself) {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    BuildState joined = JoinedByForce(seed, Nowhere);
    for (const RunIndex run : joined.runs.indices()) {
      const std::optional<JoinedFit> fit = FitJoined(options_, joined, run);
      ASSERT_TRUE(fit);
      EXPECT_EQ(fit->dof, 2 * std::ssize(fit->groups) - 4);
      EXPECT_GE(fit->chi2, -0.1);
      EXPECT_LT(fit->chi2, fit->dof) << seed;  // The floor takes up what noise there is.
    }
    EXPECT_FALSE(RemoveMisfitRun(options_, &joined));
    EXPECT_EQ(joined.runs.size(), 2U);
  }
}

TEST_F(MisfitRuns, AJoinThatIsForcedUponLandmarksThatMovedIsRefused) {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    BuildState joined = JoinedByForce(seed, EveryThird);
    ASSERT_TRUE(RemoveMisfitRun(options_, &joined)) << seed;
    ASSERT_EQ(joined.runs.size(), 1U);
    ASSERT_EQ(joined.waiting.size(), 1U);
    const WaitingRuns& waiting = joined.waiting.front();
    EXPECT_NE(waiting.runs.front().name, joined.runs.front().data->name);
    EXPECT_TRUE(waiting.explanations.frames.empty());
    EXPECT_GT(waiting.misfit.value().chi2, waiting.misfit.value().limit);
    EXPECT_FALSE(RemoveMisfitRun(options_, &joined));  // By itself it fits.
  }
}

TEST_F(MisfitRuns, AModeThatIsTakenForANearerOneSaysNothing) {
  BuildState joined = JoinedByForce(1, EveryThird);
  const std::optional<JoinedFit> fit = FitJoined(options_, joined, RunIndex(1));
  for (const GroupIndex group : joined.modes.indices()) {
    if (group.value() % 3 != 0 || joined.modes[group].empty()) continue;
    const Eigen::Vector2d place = joined.modes[group].front().p_map_landmark;
    for (int k = 0; k < 80; ++k) {  // One of them is where the run by itself has the landmark.
      const Eigen::Vector2d to(0.2 * (k / 16 + 1), 0.0);
      joined.modes[group].push_back({place + Se2(0.0, 0.0, 0.4 * k) * to, kAbsent});
    }
  }
  const std::optional<JoinedFit> without = FitJoined(options_, joined, RunIndex(1));
  ASSERT_TRUE(fit && without);
  EXPECT_LT(without->groups.size(), fit->groups.size());
  options_.confirmation.mistaken_distance_ratio = 1e3;
  EXPECT_EQ(FitJoined(options_, joined, RunIndex(1)).value().groups, fit->groups);
}

// With a hold as firm as the joint map, and noise that is right, twice the log-likelihood ratio has
// at most the χ² of the shape of the landmarks in common: what the other run adds is less than what
// the run itself does not know.
TEST_F(MisfitRuns, TheRatioOfRightJoinsIsAtMostItsChiSquare) {
  options_.modes.position_floor_m = 1e-3;
  double chi2 = 0.0;
  int dof = 0;
  for (std::uint64_t seed = 1; seed <= 8; ++seed) {
    const BuildState joined = JoinedByForce(seed, Nowhere);
    for (const RunIndex run : joined.runs.indices()) {
      const std::optional<JoinedFit> fit = FitJoined(options_, joined, run);
      chi2 += fit.value().chi2;
      dof += fit.value().dof;
    }
  }
  EXPECT_LT(chi2, 1.3 * dof);
  EXPECT_GT(chi2, 0.3 * dof);
}

// 10 to 100 % of the landmarks are elsewhere in the second run.
TEST_F(MisfitRuns, NoRunIsRefusedBecauseLandmarksMoved) {
  constexpr int kGroups = 12;
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    OpenWorldOptions world = testing::SmallWorld(seed);
    world.runs = 2;
    const auto moved = static_cast<int>(std::lround(0.1 * static_cast<double>(seed) * kGroups));
    std::vector<ModeNumber> second;
    for (int group = 0; group < kGroups; ++group) {
      second.push_back(ModeNumber(group < moved ? 2 : 1));
    }
    world.states = {std::vector<ModeNumber>(kGroups, ModeNumber(1)), second};
    const MapperResult result =
        BuildMap(testing::Inputs(testing::Simulate(world)), std::nullopt, options_).value();
    for (const AmbiguousChange& change : result.ambiguous_changes) {
      EXPECT_FALSE(change.misfit) << seed;
    }
    if (moved <= kGroups / 2) {
      EXPECT_EQ(result.runs.size(), 2U) << seed;
    }
  }
}

}  // namespace
}  // namespace shiftmap
