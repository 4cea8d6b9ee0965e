// SPDX-License-Identifier: Apache-2.0
#include "localizer/live/saved_pose.h"

#include <gtest/gtest.h>

#include "tests/support/geometry_matchers.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/localizer/simulated_run.h"

namespace shiftmap::live {
namespace {

using testing::IsOk;
using testing::StatusIs;

const Stamp kSaved = StampFromSeconds(5000.0);

SavedPose Parked() {
  SavedPose saved;
  saved.area = "area";
  saved.content_hash = "hash";
  saved.stamp = kSaved;
  saved.pose = {Se2(1.0, 2.0, 0.3), Eigen::Vector3d(0.01, 0.02, 0.03).asDiagonal()};
  saved.odometer_m = 120.5;
  return saved;
}

TEST(SavedPoseTest, SurvivesTheDiskAndNoDamage) {
  const testing::TempDir folder;
  const std::string path = folder.File("pose");
  EXPECT_THAT(ReadSavedPose(path), StatusIs(StatusCode::kNotFound, path));
  ASSERT_THAT(WriteSavedPose(Parked(), path), IsOk());
  const auto read = ReadSavedPose(path);
  ASSERT_THAT(read, IsOk());
  EXPECT_EQ(read->content_hash, "hash");
  EXPECT_EQ(read->stamp, kSaved);
  EXPECT_EQ(read->odometer_m, 120.5);
  EXPECT_EQ(read->pose.cov_T_map_vehicle, Parked().pose.cov_T_map_vehicle);

  const std::string bytes = testing::ReadFile(path);
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    std::string damaged = bytes;
    damaged[i] = static_cast<char>(damaged[i] ^ 0x10);
    testing::WriteFile(path, damaged);
    EXPECT_THAT(ReadSavedPose(path), StatusIs(StatusCode::kDataLoss, path)) << "byte " << i;
    testing::WriteFile(path, bytes.substr(0, i));
    EXPECT_THAT(ReadSavedPose(path), StatusIs(StatusCode::kDataLoss, path)) << i << " bytes";
  }
}

TEST(SavedPoseTest, UsedOnlyOnItsMapWhileYoungAndUnmoved) {
  const MapSnapshot map = Snapshot(MakeTwoModeMap(5, 10.0, 1));
  const auto start = [&](const SavedPose& saved, double age_s, std::optional<double> odometer_m) {
    return UsableStart(saved, map, kSaved + FromSeconds(age_s), odometer_m, 900.0);
  };
  ASSERT_THAT(start(Parked(), 60.0, 120.6), IsOk());
  EXPECT_THAT(start(Parked(), 60.0, std::nullopt), IsOk());
  const PoseWithCovariance pose = *start(Parked(), 60.0, 120.6);
  EXPECT_THAT(pose.T_map_vehicle, testing::IsNearPose(Parked().pose.T_map_vehicle, 0.0));
  EXPECT_GT(pose.cov_T_map_vehicle(0, 0), Parked().pose.cov_T_map_vehicle(0, 0));

  const auto refused = StatusCode::kFailedPrecondition;
  EXPECT_THAT(start(Parked(), 901.0, 120.5), StatusIs(refused, "901.0 s old"));
  EXPECT_THAT(start(Parked(), -1.0, 120.5), StatusIs(refused, "-1.0 s old"));
  EXPECT_THAT(start(Parked(), 60.0, 130.0), StatusIs(refused, "odometer"));
  SavedPose other = Parked();
  other.content_hash = "another";
  EXPECT_THAT(start(other, 60.0, 120.5), StatusIs(refused, "another"));
  other = Parked();
  other.area = "cellar";
  EXPECT_THAT(start(other, 60.0, 120.5), StatusIs(refused, "cellar"));
}

}  // namespace
}  // namespace shiftmap::live
