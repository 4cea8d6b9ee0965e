// SPDX-License-Identifier: Apache-2.0
#include "mapper/modes/doubtful_modes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "mapper/mapper.h"
#include "tests/unit/mapper/mapper_test_util.h"

namespace shiftmap {
namespace {

constexpr double kStayed = 0.3;

// A run with a visit of each of two groups, at the second of two modes; the first group is in
// doubt.
class DoubtfulModes : public ::testing::Test {
 protected:
  DoubtfulModes() {
    data_.sha256 = "a";
    BuildRun run;
    run.data = &data_;
    for (const GroupIndex group : std::vector<GroupIndex>{0, 1}) {
      problem_.modes.push_back({{{2.0, 1.0}, ModeNumber(1)}, {{2.5, 1.0}, kAbsent}});
      data_.visits.push_back({group, {}, {}, {}});
      run.assignment.push_back(GroupModeIndex(1));
    }
    problem_.runs.push_back(run);
    KeptAlternatives kept;
    kept.runs = {{"run", "a"}};
    kept.doubts = {{0, {2.02, 0.99}, kStayed}};
    problem_.kept = {kept};
  }

  // Of `absent`, the mode that it may have left, and that which it is at.
  Eigen::VectorXd Mixed(VisitIndex visit) const {
    Eigen::VectorXd log_likelihoods = Likelihoods();
    MixAlternatives(problem_, {0, visit}, &log_likelihoods);
    return log_likelihoods;
  }

  static Eigen::VectorXd Likelihoods() { return Eigen::Vector3d(-30.0, -12.0, -1.0); }

  MappingRun data_;
  BuildState problem_;
};

TEST_F(DoubtfulModes, HaveTheProbabilitiesOfTheMixture) {
  const Eigen::VectorXd mixed = Mixed(0);
  EXPECT_NEAR(mixed[1] - mixed[2], std::log(kStayed / (1.0 - kStayed)), 1e-12);
  EXPECT_EQ(mixed[2], Likelihoods()[2]);
  EXPECT_EQ(mixed[0], Likelihoods()[0]);
  // From modes that are equally likely, and `absent` that is not.
  const double at_first = std::exp(mixed[1]) / (std::exp(mixed[1]) + std::exp(mixed[2]));
  EXPECT_NEAR(at_first, kStayed, 1e-12);
}

TEST_F(DoubtfulModes, LeaveOtherLandmarksAndOtherRunsAsTheyAre) {
  EXPECT_EQ(Mixed(1), Likelihoods());
  data_.sha256 = "b";
  EXPECT_EQ(Mixed(0), Likelihoods());
}

TEST_F(DoubtfulModes, AreSettledOnceTheyAreOne) {
  DropSettledAlternatives(&problem_);
  EXPECT_EQ(problem_.kept.size(), 1U);
  problem_.runs.front().assignment[0] = GroupModeIndex(0);  // Merged.
  EXPECT_EQ(Mixed(0), Likelihoods());
  DropSettledAlternatives(&problem_);
  EXPECT_TRUE(problem_.kept.empty());
}

TEST_F(DoubtfulModes, OfARunThatWasTakenOutAreNone) {
  problem_.runs.clear();
  DropSettledAlternatives(&problem_);
  EXPECT_TRUE(problem_.kept.empty());
}

// Of twelve landmarks five stayed, six moved far, and one by 0.6 m, which the noisy run tells with
// a probability of 0.98 or so.
TEST(BuildMapWithDoubtfulModes, KeepsBothPlacesWithTheProbabilitiesOfTheAlternatives) {
  constexpr std::size_t kDoubtful = 5;
  OpenWorldOptions options = testing::SmallWorld(9);
  options.modes_per_group = 1;
  options.runs = 2;
  options.duration_s = 80.0;
  options.sensor.sd_range_m = 0.25;
  options.sensor.sd_bearing_rad = 0.05;
  options.odometry.noise_v = 0.03;
  options.odometry.noise_omega = 0.03;
  SimulatedWorld world = testing::Simulate(options);
  auto at = world.runs[1].truth.begin();
  for (Scan& scan : world.runs[1].run.scans) {
    while (at->stamp < scan.stamp) ++at;
    const Se2& pose = at->T_map_vehicle;
    for (Observation& observation : scan.observations) {
      std::size_t group = 0;
      while (world.groups[group].signature != observation.signature) ++group;
      if (group < kDoubtful) continue;
      const double direction = group == kDoubtful ? 9.0 : 2.0 * static_cast<double>(group);
      const Eigen::Vector2d moved_by = (group == kDoubtful ? 0.56 : 2.5) *
                                       Eigen::Vector2d(std::cos(direction), std::sin(direction));
      const Eigen::Vector2d p =
          pose.Inverse() * (pose * observation.PositionInVehicle() + moved_by);
      observation.z = {p.norm(), std::atan2(p.y(), p.x())};
    }
  }
  const MapperResult result =
      BuildMap(testing::Inputs(world), std::nullopt, MapperOptions()).value();
  ASSERT_EQ(result.runs.size(), 2U);
  ASSERT_EQ(result.ambiguous_changes.size(), 1U);
  const AmbiguousChange& change = result.ambiguous_changes.front();
  EXPECT_FALSE(change.waits);
  EXPECT_EQ(change.runs.front().name, "run-1");
  EXPECT_GE(change.explanations.size(), 2U);
  ASSERT_EQ(change.deciding.size(), 1U);
  const std::vector<LandmarkGroup>& groups = result.content.groups;
  const auto group = std::find_if(groups.begin(), groups.end(), [&](const LandmarkGroup& known) {
    return known.signature == change.deciding.front();
  });
  ASSERT_NE(group, groups.end());
  ASSERT_EQ(group->modes.size(), 2U);
  int rows = 0;
  for (const VisitEvidence& row : result.runs[1].evidence) {
    if (row.signature != group->signature || row.observations == 0) continue;
    const double log_odds = row.modes[1].log_likelihood - row.modes[2].log_likelihood;
    EXPECT_LT(std::abs(log_odds), std::log(99.0) + 1e-9);
    ++rows;
  }
  EXPECT_GT(rows, 0);
}

}  // namespace
}  // namespace shiftmap
