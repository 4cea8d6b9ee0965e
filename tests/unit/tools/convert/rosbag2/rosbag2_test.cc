// SPDX-License-Identifier: Apache-2.0
#include "tools/convert/rosbag2/rosbag2.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <zstd.h>

#include <filesystem>

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/tools/convert/rosbag2/bag_test_util.h"
#include "tools/convert/rosbag2/bag_files.h"
#include "tools/convert/rosbag2/frame_tree.h"

namespace shiftmap::rosbag2 {
namespace {

using shiftmap::testing::IsOk;
using shiftmap::testing::ReadFile;
using shiftmap::testing::StatusIs;
using shiftmap::testing::TempDir;
using shiftmap::testing::WriteFile;
using ::testing::ElementsAre;

class Rosbag2Test : public ::testing::Test {
 protected:
  StatusOr<Rosbag2Run> ReadMcap(const std::vector<testing::Message>& messages) {
    testing::WriteMcapBag(dir_.File("bag.mcap"), messages);
    options_.path = dir_.File("bag.mcap");
    return ReadRosbag2(options_);
  }
  // Of a SQLite file of the small drive after some SQL.
  StatusOr<Rosbag2Run> ReadSqlite(const std::string& sql) {
    options_.path = dir_.File(fmt::format("bag_{}.db3", ++files_));
    testing::WriteSqliteBag(options_.path, testing::SmallDrive());
    if (!sql.empty()) testing::ExecuteSql(options_.path, sql);
    return ReadRosbag2(options_);
  }

  TempDir dir_;
  Rosbag2Options options_;
  int files_ = 0;
};

TEST_F(Rosbag2Test, BothContainersGiveTheSameRun) {
  const auto mcap = ReadMcap(testing::SmallDrive());
  const auto sqlite = ReadSqlite("");
  ASSERT_THAT(mcap.status(), IsOk());
  ASSERT_THAT(sqlite.status(), IsOk());
  for (const auto* run : {&mcap->run, &sqlite->run}) {
    ASSERT_EQ(run->odometry.size(), 5U);
    ASSERT_EQ(run->scans.size(), 5U);
    EXPECT_TRUE(run->scans[2].observations.empty());
    const Observation& seen = run->scans[1].observations.at(0);
    EXPECT_EQ(seen.signature.text(), "L1");
    EXPECT_LT((seen.z - Eigen::Vector2d(3.0, 1.0)).norm(), 1e-12);
    EXPECT_LT((*seen.cov_z - 0.04 * Eigen::Matrix2d::Identity()).norm(), 1e-12);
  }
  EXPECT_FALSE(mcap->builtin_definitions);
  EXPECT_TRUE(sqlite->builtin_definitions);
}

TEST_F(Rosbag2Test, LateMessagesArePutInOrder) {
  auto messages = testing::SmallDrive();
  std::swap(messages[1], messages[3]);
  const auto run = ReadMcap(messages);
  ASSERT_THAT(run.status(), IsOk());
  EXPECT_EQ(run->late_items, 1);
  EXPECT_THAT(ValidateRun(run->run), IsOk());
}

TEST_F(Rosbag2Test, TwoCandidatesAreNamed) {
  auto messages = testing::SmallDrive();
  messages.push_back({"/odom", "nav_msgs/msg/Odometry", 1, testing::Odometry(1, 0.0, 0.0)});
  EXPECT_THAT(ReadMcap(messages).status(),
              StatusIs(StatusCode::kInvalidArgument,
                       "odometry on more than one topic, choose by --odometry-topic: "
                       "'/odom' (nav_msgs/msg/Odometry), '/twist'"));
  options_.odometry_topic = "/twist";
  EXPECT_THAT(ReadMcap(messages).status(), IsOk());
}

TEST_F(Rosbag2Test, AprilTagsWithoutATransformAreLeftOut) {
  auto messages = testing::SmallDrive();
  std::erase_if(messages, [](const auto& message) { return message.topic == "/detections"; });
  const std::int64_t stamp_ns = messages[1].log_time_ns;
  messages.push_back({"/tags",
                      "apriltag_msgs/msg/AprilTagDetectionArray",
                      stamp_ns,
                      testing::AprilTags(stamp_ns, {3, 4})});
  EXPECT_THAT(ReadMcap(messages).status(),
              StatusIs(StatusCode::kInvalidArgument, "none of 2 detections has a position"));
  testing::TestTransform tag{"camera", "tag36h11:4"};
  tag.T.translation() = Eigen::Vector3d(2.0, 1.0, 0.0);
  messages.push_back(
      {"/tf", "tf2_msgs/msg/TFMessage", stamp_ns, testing::Transforms(stamp_ns, {tag})});
  const auto run = ReadMcap(messages);
  ASSERT_THAT(run.status(), IsOk());
  EXPECT_EQ(run->dropped_detections, 1);
  ASSERT_EQ(run->run.scans[0].observations.size(), 1U);
  EXPECT_EQ(run->run.scans[0].observations[0].signature.text(), "tag36h11:4");
  EXPECT_LT(
      (run->run.scans[0].observations[0].PositionInVehicle() - Eigen::Vector2d(2.5, 1.0)).norm(),
      1e-12);
}

TEST_F(Rosbag2Test, StampsOfZeroAreToldApart) {
  auto messages = testing::SmallDrive();
  messages[1].data = testing::Twist(0, 1.0, 0.0);
  EXPECT_THAT(ReadMcap(messages).status(),
              StatusIs(StatusCode::kInvalidArgument, "stamp is 0; try --stamps log"));
  options_.log_time = true;
  EXPECT_THAT(ReadMcap(messages).status(), IsOk());
}

TEST_F(Rosbag2Test, VelocitiesMayBeThoseOfThePoses) {
  auto messages = testing::SmallDrive();
  for (testing::Message& message : messages) {
    if (message.topic != "/twist") continue;
    message.type = "nav_msgs/msg/Odometry";
    const double seconds =
        static_cast<double>(message.log_time_ns - messages[1].log_time_ns) * 1e-9;
    Eigen::Isometry3d T(Eigen::AngleAxisd(1.0, Eigen::Vector3d::UnitZ()));
    T.translation() = T.linear() * Eigen::Vector3d(2.0 * seconds, 0.0, 0.0);
    message.data = testing::Odometry(message.log_time_ns, 0.0, 0.0, T);
  }
  EXPECT_EQ(ReadMcap(messages)->run.odometry[0].v_mps, 0.0);
  options_.odometry_from_pose = true;
  const auto run = ReadMcap(messages);
  ASSERT_THAT(run.status(), IsOk());
  ASSERT_EQ(run->run.odometry.size(), 5U);
  for (const OdometrySample& sample : run->run.odometry) {
    EXPECT_NEAR(sample.v_mps, 2.0, 1e-9);
    EXPECT_NEAR(sample.omega_radps, 0.0, 1e-9);
  }
  EXPECT_THAT(ReadMcap(testing::SmallDrive()).status(),
              StatusIs(StatusCode::kInvalidArgument, "has no pose"));
}

TEST_F(Rosbag2Test, HostileDatabasesGiveOneClearLine) {
  const auto refuse = [&](const std::string& sql, const std::string& part) {
    const Status status = ReadSqlite(sql).status();
    EXPECT_FALSE(status.ok()) << sql;
    EXPECT_NE(status.code(), StatusCode::kInternal) << sql << ": " << Message(status);
    EXPECT_THAT(Message(status), ::testing::StartsWith("bag '"));
    EXPECT_THAT(Message(status), ::testing::HasSubstr(part)) << sql;
    EXPECT_EQ(Message(status).find('\n'), std::string::npos);
  };
  refuse("DROP TABLE messages", "messages");
  refuse("DROP TABLE topics", "topics");
  refuse("ALTER TABLE messages RENAME TO m; CREATE VIEW messages AS SELECT * FROM m", "messages");
  refuse("UPDATE topics SET type = 'nav_msgs/msg/Odometry' WHERE name = '/twist'",
         "message of nav_msgs/Odometry: ends inside a field");
  refuse("UPDATE topics SET serialization_format = 'json'", "encoding 'json', expected cdr");
  refuse("UPDATE messages SET data = 'text'", "message of");
  refuse("UPDATE messages SET data = zeroblob(17000000)", "expected at most");
  refuse("UPDATE messages SET data = x'28b52ffd00'", "compressed message");
  refuse("DELETE FROM messages", "no odometry");
  refuse("UPDATE topics SET name = 'same'", "is of type");
  // Values of another type are what SQLite makes of them: no crash, and no endless work.
  ReadSqlite("UPDATE messages SET topic_id = 1e300, timestamp = 'x'").status().IgnoreError();
  ReadSqlite("UPDATE messages SET timestamp = -9223372036854775808").status().IgnoreError();
}

TEST_F(Rosbag2Test, AnUnfinishedDatabaseIsReadWithItsLogAndLeftAsItIs) {
  // As after a power cut: the recorder's last messages are in the log beside the file.
  const std::string whole = dir_.File("whole.db3");
  testing::WriteSqliteBag(whole, testing::SmallDrive());
  testing::ExecuteSql(whole, "PRAGMA journal_mode=WAL");
  const std::string bag = dir_.File("bag");
  std::filesystem::create_directory(bag);
  testing::CopyWhileOpen(whole, "DELETE FROM messages WHERE id > 5", bag + "/bag_0.db3");
  ASSERT_GT(std::filesystem::file_size(bag + "/bag_0.db3-wal"), 0U);
  const std::string before = ReadFile(bag + "/bag_0.db3-wal");
  options_.path = bag;
  const auto run = ReadRosbag2(options_);
  ASSERT_THAT(run.status(), IsOk());
  EXPECT_EQ(run->run.odometry.size() + run->run.scans.size(), 4U);
  EXPECT_EQ(ReadFile(bag + "/bag_0.db3-wal"), before);
  EXPECT_FALSE(std::filesystem::exists(bag + "/bag_0.db3-shm"));
}

TEST_F(Rosbag2Test, AFileThatExpandsTooFarIsRefused) {
  std::string bomb;
  const std::string zeros(std::size_t{64} << 20, '\0');
  std::string frame(ZSTD_compressBound(zeros.size()), '\0');
  frame.resize(ZSTD_compress(frame.data(), frame.size(), zeros.data(), zeros.size(), 1));
  for (int i = 0; i < 4; ++i) bomb += frame;
  WriteFile(dir_.File("bag_0.mcap.zstd"), bomb);
  options_.path = dir_.File("bag_0.mcap.zstd");
  EXPECT_THAT(ReadRosbag2(options_).status(),
              StatusIs(StatusCode::kDataLoss, "expand to more than"));
}

TEST(BagFiles, AreInTheOrderOfTheirNumbers) {
  const TempDir dir;
  for (const char* name : {"b_10.db3", "b_9.db3", "b_2.db3.zstd", "b_2.db3", "notes.txt"}) {
    WriteFile(dir.File(name), "");
  }
  std::vector<std::string> names;
  const std::vector<BagFile> files = FindBagFiles(dir.path()).value();
  for (const BagFile& file : files) {
    names.push_back(std::filesystem::path(file.path).filename());
  }
  // What a player decompressed beside the compressed file is not read twice.
  EXPECT_THAT(names, ElementsAre("b_2.db3", "b_9.db3", "b_10.db3"));
}

TEST(BagFiles, AreInTheBagsFolderWhateverTheMetadataSay) {
  const TempDir dir;
  WriteFile(dir.File("metadata.yaml"),
            "rosbag2_bagfile_information:\n  relative_file_paths:\n"
            "    - ../../etc/b_1.mcap\n    - /b_0.db3.zstd\n");
  const auto files = FindBagFiles(dir.path()).value();
  ASSERT_EQ(files.size(), 2U);
  EXPECT_EQ(files[0].path, dir.File("b_1.mcap"));
  EXPECT_EQ(files[1].path, dir.File("b_0.db3.zstd"));
  EXPECT_TRUE(files[1].zstd);
}

TEST(FrameTree, FollowsChainsInBothDirections) {
  FrameTree tree;
  const auto add = [&](const char* parent, const char* child, double x, double yaw) {
    FrameTransform transform;
    transform.parent = parent;
    transform.child = child;
    transform.T_parent_child.translation().x() = x;
    transform.T_parent_child.rotate(Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()));
    tree.Add(transform);
  };
  add("footprint", "base", 1.0, 0.5);
  add("base", "mast", 2.0, 0.0);
  add("mast", "camera", 3.0, std::acos(0.0));
  add("a", "b", 1.0, 0.0);
  const auto T = tree.Lookup("base", "camera");
  ASSERT_THAT(T.status(), IsOk());
  EXPECT_LT((*T * Eigen::Vector3d(1, 0, 0) - Eigen::Vector3d(5, 1, 0)).norm(), 1e-12);
  const auto up = tree.Lookup("camera", "footprint");
  ASSERT_THAT(up.status(), IsOk());
  const Eigen::Isometry3d loop = tree.Lookup("footprint", "camera").value() * *up;
  EXPECT_TRUE(loop.isApprox(Eigen::Isometry3d::Identity()));
  EXPECT_THAT(tree.Lookup("base", "b").status(),
              StatusIs(StatusCode::kNotFound, "only to 'base', 'camera', 'footprint', 'mast'"));
}

}  // namespace
}  // namespace shiftmap::rosbag2
