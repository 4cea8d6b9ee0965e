// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/tiv_approximations.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <limits>

#include "proto/core/check.h"
#include "tests/support/status_matchers.h"
#include "tools/experiment/tiv_approximations_figure.h"

namespace shiftmap {
namespace {

using ::testing::HasSubstr;
using testing::StatusIs;

std::vector<TivApproximationsRow> RunExperiment(const TivApproximationsOptions& options) {
  StatusOr<std::vector<TivApproximationsRow>> rows = RunTivApproximations(options, {});
  SHIFTMAP_CHECK(rows.ok(), "{}", Message(rows.status()));
  return *std::move(rows);
}

// All arms get these drives; what false alarms add is the only difference.
TEST(TivApproximations, DrivesWithFalseAlarmsAreTheOthersAndFalseAlarms) {
  int added = 0;
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    const ApproximationsDrive without = SimulateApproximationsDrive({}, seed, false);
    const ApproximationsDrive with = SimulateApproximationsDrive({}, seed, true);
    for (std::size_t i = 0; i < without.scans.size(); ++i) {
      EXPECT_EQ((without.T_map_vehicle[i].Inverse() * with.T_map_vehicle[i]).Log().norm(), 0.0);
      for (const Observation& seen : without.scans[i].observations) {
        const auto& others = with.scans[i].observations;
        EXPECT_TRUE(std::any_of(others.begin(), others.end(), [&](const Observation& other) {
          return other.signature == seen.signature && other.z == seen.z;
        }));
      }
      added += static_cast<int>(with.scans[i].observations.size()) -
               static_cast<int>(without.scans[i].observations.size());
    }
  }
  EXPECT_GT(added, 0);
}

TEST(TivApproximations, LandmarksStandWhereTheirFateSays) {
  const ApproximationsDriveOptions options;
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    const ApproximationsDrive drive = SimulateApproximationsDrive(options, seed, false);
    ASSERT_EQ(ValidateMapContent(drive.map).code(), StatusCode::kOk);
    for (std::size_t g = 0; g < drive.landmarks.size(); ++g) {
      const TivLandmark& landmark = drive.landmarks[g];
      double nearest = std::numeric_limits<double>::infinity();
      for (const Mode& mode : drive.map.groups[g].modes) {
        nearest = std::min(nearest, (mode.p_map_landmark - landmark.place).norm());
      }
      if (landmark.true_state > landmark.modes) {
        EXPECT_GE(nearest, options.shift_min_m);
      } else {
        EXPECT_LT(nearest, 6.0 * options.sd_mode_m);
      }
    }
  }
}

TEST(TivApproximations, RowsDoNotDependOnTheThreads) {
  TivApproximationsOptions options;
  options.drives = 5;
  const std::vector<TivApproximationsRow> one = RunExperiment(options);
  options.threads = 3;
  const std::vector<TivApproximationsRow> three = RunExperiment(options);
  ASSERT_EQ(one.size(), 2 * TivArms().size());
  ASSERT_EQ(one.size(), three.size());
  for (std::size_t i = 0; i < one.size(); ++i) {
    EXPECT_EQ(one[i].rmse_m.mean, three[i].rmse_m.mean) << one[i].arm.name;
    EXPECT_EQ(one[i].nees.mean, three[i].nees.mean) << one[i].arm.name;
    EXPECT_EQ(one[i].leaves, three[i].leaves) << one[i].arm.name;
  }
}

// The pairing: where an arm does what the first does, the difference is exactly none.
TEST(TivApproximations, ArmsArePairedByDrive) {
  TivApproximationsOptions options;
  options.drives = 3;
  for (const TivApproximationsRow& row : RunExperiment(options)) {
    if (row.arm.name != TivArms().front().name) continue;
    EXPECT_EQ(row.rmse_paired_m.mean, 0.0);
    EXPECT_EQ(row.rmse_paired_m.standard_error, 0.0);
  }
}

// Where all landmarks stay and nothing is false, no arm has more than one leaf at the end, and all
// are the same filter.
TEST(TivApproximations, ArmsAgreeWhereNothingMoved) {
  ApproximationsDrive drive = SimulateApproximationsDrive({}, 1, false);
  for (std::size_t i = 0; i < drive.scans.size(); ++i) {
    std::erase_if(drive.scans[i].observations, [&](const Observation& observation) {
      const auto g = static_cast<std::size_t>(std::stoi(observation.signature.text().substr(1)));
      return drive.landmarks[g].fate != LandmarkFate::kStays;
    });
  }
  const std::vector<double> first = RunApproximationsDrive(drive, TivArms().front().options).nees;
  for (const TivArm& arm : TivArms()) {
    if (arm.options.update_ungated) continue;  // Sightings beyond the gate are one in a hundred.
    const std::vector<double> nees = RunApproximationsDrive(drive, arm.options).nees;
    EXPECT_NEAR(nees.back(), first.back(), 0.5) << arm.name;
  }
}

TEST(TivApproximations, OptionsOutOfRangeAreNamed) {
  TivApproximationsOptions options;
  options.drive.sd_mode_m = 0.0;
  EXPECT_THAT(RunTivApproximations(options, {}),
              StatusIs(StatusCode::kInvalidArgument, "sd_mode_m"));
}

// T-IV figure 3 (b), (c): the wrong hypothesis adapts and leads, until L01 comes into view.
TEST(TivFigure, TheWrongHypothesisLeadsUntilTheSecondLandmarkIsSeen) {
  const TivFigureScene scene = MakeTivFigureScene();
  const std::vector<HypothesisPair> pairs = FollowTivFigure(scene, true);
  const HypothesisPair& before = pairs[static_cast<std::size_t>(scene.second_seen) - 1];
  EXPECT_GT(before.ProbabilityOfA(), before.ProbabilityOfB());
  ASSERT_TRUE(before.a && before.b);
  const Se2& truth = scene.drive.T_map_vehicle[static_cast<std::size_t>(scene.second_seen) - 1];
  const auto error = [&](const HypothesisView& view) {
    return (view.pose.T_map_vehicle.translation() - truth.translation()).norm();
  };
  EXPECT_GT(error(*before.a), 2.0 * error(*before.b));  // A has adapted.
  for (std::size_t i = static_cast<std::size_t>(scene.second_seen) + 3; i < pairs.size(); ++i) {
    EXPECT_GT(pairs[i].ProbabilityOfB(), 0.99) << i;
  }
}

// T-IV figure 3 (d).
TEST(TivFigure, TheWrongHypothesisIsRejectedQuicklyIfOnlyWhatGatesCorrects) {
  const TivFigureScene scene = MakeTivFigureScene();
  const std::vector<HypothesisPair> pairs = FollowTivFigure(scene, false);
  int observations = 0;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const auto& seen = scene.drive.scans[i].observations;
    observations += std::any_of(seen.begin(), seen.end(), [&](const Observation& observation) {
      return observation.signature == scene.drive.map.groups[0].signature;
    });
    if (observations >= 3) {
      EXPECT_GT(pairs[i].ProbabilityOfB(), pairs[i].ProbabilityOfA()) << i;
    }
  }
}

TEST(TivFigure, IsDrawnWithBothHypotheses) {
  const TivFigureScene scene = MakeTivFigureScene();
  const std::string svg =
      DrawTivFigure(scene, FollowTivFigure(scene, true), FollowTivFigure(scene, false));
  for (const char* title : {"(a)", "(b)", "(c)", "(d)"}) EXPECT_THAT(svg, HasSubstr(title));
  EXPECT_THAT(svg, HasSubstr("stroke-dasharray"));
}

}  // namespace
}  // namespace shiftmap
