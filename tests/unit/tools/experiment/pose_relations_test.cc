// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/pose_relations.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <string>

#include "tests/support/temp_dir.h"
#include "tools/convert/lidar_json.h"

namespace shiftmap {
namespace {

std::vector<StampedPose> Path(const Se2& T_new_old) {
  std::vector<StampedPose> path;
  for (int i = 0; i < 4; ++i) {
    path.push_back({StampFromSeconds(10.0 + i), T_new_old * Se2(1.0 * i, 0.5 * i, 0.3 * i)});
  }
  return path;
}

TEST(PoseRelations, CountErrorsWhereTheyAreMade) {
  const std::vector<StampedPose> truth = Path(Se2());
  std::vector<PoseRelation> relations = RelationsAlong(truth, 1);
  ASSERT_EQ(relations.size(), 3U);
  relations.push_back({StampFromSeconds(9.0), truth[0].stamp, Se2()});  // Not of the path.
  // In another frame: no error.
  const auto none = EvaluateRelations(Path(Se2(3.0, -7.0, 2.0)), relations);
  ASSERT_TRUE(none.ok()) << Message(none.status());
  EXPECT_EQ(none->matched, 3);
  EXPECT_LT(none->translation_mean_m, 1e-12);
  EXPECT_LT(none->rotation_mean_rad, 1e-12);
  // One wrong step moves all that follow, and counts once.
  std::vector<StampedPose> path = truth;
  const Se2 wrong = path[0].T_map_vehicle.Inverse() * path[1].T_map_vehicle * Se2(0.3, 0.4, -0.6);
  const Se2 T_wrong_right = path[0].T_map_vehicle * wrong * path[1].T_map_vehicle.Inverse();
  for (std::size_t i = 1; i < path.size(); ++i) {
    path[i].T_map_vehicle = T_wrong_right * path[i].T_map_vehicle;
  }
  const auto error = EvaluateRelations(path, relations);
  ASSERT_TRUE(error.ok());
  EXPECT_NEAR(error->translation_mean_m, 0.5 / 3.0, 1e-12);
  EXPECT_NEAR(error->translation_mean_square_m2, 0.25 / 3.0, 1e-12);
  EXPECT_NEAR(error->translation_sd_m, std::sqrt(0.25 / 3.0 - 0.25 / 9.0), 1e-12);
  EXPECT_NEAR(error->rotation_mean_rad, 0.2, 1e-12);
  EXPECT_NEAR(error->rotation_mean_square_rad2, 0.36 / 3.0, 1e-12);
}

TEST(PoseRelations, NeedPosesAtTheirTimes) {
  const std::vector<PoseRelation> relations = {
      {StampFromSeconds(10.5), StampFromSeconds(11.5), Se2()}};
  EXPECT_EQ(EvaluateRelations(Path(Se2()), relations).status().code(),
            StatusCode::kInvalidArgument);
}

TEST(PoseRelations, ReadsRowsInThePlane) {
  const testing::TempDir folder;
  const std::string path = folder.File("a.relations");
  testing::WriteFile(path, "10.5 12.25 -1.5 0.25 0.0 0.0 0.0 -0.75\n");
  const auto relations = ReadPoseRelations(path);
  ASSERT_TRUE(relations.ok()) << Message(relations.status());
  ASSERT_EQ(relations->size(), 1U);
  EXPECT_EQ(relations->front().a, StampFromSeconds(10.5));
  EXPECT_EQ(relations->front().b, StampFromSeconds(12.25));
  EXPECT_EQ(relations->front().T_a_b.translation(), Eigen::Vector2d(-1.5, 0.25));
  EXPECT_EQ(relations->front().T_a_b.yaw(), -0.75);
  testing::WriteFile(path, "10.5 12.25 -1.5 0.25 0.0 0.1 0.0 -0.75\n");
  EXPECT_NE(Message(ReadPoseRelations(path).status()).find("a.relations:1: z, roll or pitch"),
            std::string::npos);
  testing::WriteFile(path, "10.5 12.25 -1.5\n");
  EXPECT_NE(Message(ReadPoseRelations(path).status()).find("3 fields, expected 8"),
            std::string::npos);
}

// The corrected log is as good as its relations say: this tells which way round they are.
TEST(PoseRelationsData, HoldForTheCorrectedLog) {
  const char* data = std::getenv("SHIFTMAP_DATA");
  const auto root = std::filesystem::path(data != nullptr ? data : "../shared/data") / "lidar";
  if (!std::filesystem::exists(root)) {
    GTEST_SKIP() << "no lidar data: set SHIFTMAP_DATA to the folder that holds it";
  }
  const auto log = ReadLidarJson((root / "intel_corrected_log.json").string());
  const auto relations = ReadPoseRelations((root / "intel.relations").string());
  ASSERT_TRUE(log.ok() && relations.ok());
  const auto error = EvaluateRelations(log->poses, *relations);
  ASSERT_TRUE(error.ok()) << Message(error.status());
  EXPECT_GT(error->matched, 50);
  EXPECT_LT(error->translation_mean_m, 0.06);
  EXPECT_LT(error->rotation_mean_rad, 0.02);
}

}  // namespace
}  // namespace shiftmap
