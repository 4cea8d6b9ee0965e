// SPDX-License-Identifier: Apache-2.0
//
// Messages as ROS 2 serializes them, by Fast-CDR itself, and small bags of them.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <string>
#include <vector>

namespace shiftmap::rosbag2::testing {

struct Message {
  std::string topic;
  std::string type;  ///< "nav_msgs/msg/Odometry".
  std::int64_t log_time_ns = 0;
  std::string data;
};

enum class ByteOrder { kLittle, kBig };

/// A transform without translation and rotation but what is named.
struct TestTransform {
  std::string parent;
  std::string child;
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
};

struct TestDetection {
  std::string class_id;
  Eigen::Vector3d p = Eigen::Vector3d::Zero();
  double variance = 0.0;
};

std::string Twist(std::int64_t stamp_ns,
                  double v_mps,
                  double omega_radps,
                  ByteOrder order = ByteOrder::kLittle);
std::string Odometry(std::int64_t stamp_ns,
                     double v_mps,
                     double omega_radps,
                     const Eigen::Isometry3d& T_odom_vehicle = Eigen::Isometry3d::Identity());
std::string Transforms(std::int64_t stamp_ns, const std::vector<TestTransform>& transforms);
std::string Detections(std::int64_t stamp_ns, const std::vector<TestDetection>& detections);
std::string AprilTags(std::int64_t stamp_ns, const std::vector<std::int32_t>& ids);

/// A drive of two seconds past a landmark, with a camera at (0.5, 0, 1).
std::vector<Message> SmallDrive();

/// Writes messages as a bag of one file, with the built-in definitions.
void WriteMcapBag(const std::string& path, const std::vector<Message>& messages);

/// As ROS 2 Humble does: without definitions.
void WriteSqliteBag(const std::string& path, const std::vector<Message>& messages);

/// Copies a database, with its log of writes, after some SQL that is not in the file itself yet: as
/// a recorder that was killed leaves it. Precondition: it is in WAL mode.
void CopyWhileOpen(const std::string& path, const std::string& sql, const std::string& copy);

/// Runs SQL on a file that is made if it is not there; aborts if it fails.
void ExecuteSql(const std::string& path, const std::string& sql);

}  // namespace shiftmap::rosbag2::testing
