// SPDX-License-Identifier: Apache-2.0
#include "tests/unit/tools/convert/rosbag2/bag_test_util.h"

#include <fastcdr/Cdr.h>
#include <fastcdr/FastBuffer.h>
#include <sqlite3.h>

#include <filesystem>
#include <fstream>
#include <functional>
#include <map>

#include "proto/core/check.h"
#include "proto/mcap/writer.h"
#include "tools/convert/rosbag2/builtin_definitions.h"

namespace shiftmap::rosbag2::testing {
namespace {

using eprosima::fastcdr::Cdr;
using eprosima::fastcdr::FastBuffer;

std::string Serialize(const std::function<void(Cdr&)>& write,
                      ByteOrder order = ByteOrder::kLittle) {
  FastBuffer buffer;
  Cdr cdr(buffer,
          order == ByteOrder::kBig ? Cdr::BIG_ENDIANNESS : Cdr::LITTLE_ENDIANNESS,
          Cdr::DDS_CDR);
  cdr.serialize_encapsulation();
  write(cdr);
  return {cdr.getBufferPointer(), cdr.getSerializedDataLength()};
}

void WriteHeader(Cdr& cdr, std::int64_t stamp_ns, const std::string& frame) {
  constexpr std::int64_t kSecond = 1'000'000'000;
  cdr << static_cast<std::int32_t>(stamp_ns / kSecond)
      << static_cast<std::uint32_t>(stamp_ns % kSecond) << frame;
}

void WriteVector(Cdr& cdr, const Eigen::Vector3d& v) { cdr << v.x() << v.y() << v.z(); }

void WritePose(Cdr& cdr, const Eigen::Isometry3d& T) {
  WriteVector(cdr, T.translation());
  const Eigen::Quaterniond q(T.linear());
  cdr << q.x() << q.y() << q.z() << q.w();
}

void WriteCovariance(Cdr& cdr, double variance) {
  for (int row = 0; row < 6; ++row) {
    for (int column = 0; column < 6; ++column) cdr << (row == column ? variance : 0.0);
  }
}

}  // namespace

std::string Twist(std::int64_t stamp_ns, double v_mps, double omega_radps, ByteOrder order) {
  return Serialize(
      [&](Cdr& cdr) {
        WriteHeader(cdr, stamp_ns, "base_link");
        WriteVector(cdr, {v_mps, 0.0, 0.0});
        WriteVector(cdr, {0.0, 0.0, omega_radps});
      },
      order);
}

std::string Odometry(std::int64_t stamp_ns,
                     double v_mps,
                     double omega_radps,
                     const Eigen::Isometry3d& T_odom_vehicle) {
  return Serialize([&](Cdr& cdr) {
    WriteHeader(cdr, stamp_ns, "odom");
    cdr << std::string("base_link");
    WritePose(cdr, T_odom_vehicle);
    WriteCovariance(cdr, 0.0);
    WriteVector(cdr, {v_mps, 0.0, 0.0});
    WriteVector(cdr, {0.0, 0.0, omega_radps});
    WriteCovariance(cdr, 0.0);
  });
}

std::string Transforms(std::int64_t stamp_ns, const std::vector<TestTransform>& transforms) {
  return Serialize([&](Cdr& cdr) {
    cdr << static_cast<std::uint32_t>(transforms.size());
    for (const TestTransform& transform : transforms) {
      WriteHeader(cdr, stamp_ns, transform.parent);
      cdr << transform.child;
      WritePose(cdr, transform.T);
    }
  });
}

std::string Detections(std::int64_t stamp_ns, const std::vector<TestDetection>& detections) {
  return Serialize([&](Cdr& cdr) {
    WriteHeader(cdr, stamp_ns, "camera");
    cdr << static_cast<std::uint32_t>(detections.size());
    for (const TestDetection& detection : detections) {
      Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
      T.translation() = detection.p;
      WriteHeader(cdr, stamp_ns, "camera");
      cdr << std::uint32_t{1} << detection.class_id << 0.9;
      WritePose(cdr, T);
      WriteCovariance(cdr, detection.variance);
      WritePose(cdr, T);
      WriteVector(cdr, {0.1, 0.1, 0.1});
      cdr << std::string("track");
    }
  });
}

std::string AprilTags(std::int64_t stamp_ns, const std::vector<std::int32_t>& ids) {
  return Serialize([&](Cdr& cdr) {
    WriteHeader(cdr, stamp_ns, "camera");
    cdr << static_cast<std::uint32_t>(ids.size());
    for (const std::int32_t id : ids) {
      cdr << std::string("tag36h11") << id << std::int32_t{0} << 0.5f << 50.0f;
      for (int i = 0; i < 2 + 8 + 9; ++i) cdr << 1.0 * i;  // Centre, corners, homography.
    }
  });
}

std::vector<Message> SmallDrive() {
  constexpr std::int64_t kBegin = 1'767'600'000'000'000'000;
  TestTransform mount{"base_link", "camera"};
  mount.T.translation() = Eigen::Vector3d(0.5, 0.0, 1.0);
  std::vector<Message> messages = {
      {"/tf_static", "tf2_msgs/msg/TFMessage", kBegin, Transforms(kBegin, {mount})}};
  for (int i = 0; i < 5; ++i) {
    const std::int64_t stamp_ns = kBegin + i * std::int64_t{500'000'000};
    messages.push_back(
        {"/twist", "geometry_msgs/msg/TwistStamped", stamp_ns, Twist(stamp_ns, 1.0, 0.1)});
    const TestDetection seen{"L1", Eigen::Vector3d(3.0 - 0.5 * i, 1.0, -0.4), 0.04};
    messages.push_back(
        {"/detections",
         "vision_msgs/msg/Detection3DArray",
         stamp_ns + 1000,
         Detections(stamp_ns, i == 2 ? std::vector<TestDetection>() : std::vector{seen})});
  }
  return messages;
}

void WriteMcapBag(const std::string& path, const std::vector<Message>& messages) {
  std::ofstream out(path, std::ios::binary);
  mcap::Writer writer(
      [&](std::string_view bytes) {
        out.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
        return OkStatus();
      },
      {.compression = mcap::Compression::kNone});
  std::map<std::string, std::uint16_t> channels;
  for (const Message& message : messages) {
    if (channels.count(message.topic) > 0) continue;
    const auto schema = writer.AddSchema(message.type, "ros2msg", BuiltinDefinition(message.type));
    channels[message.topic] = writer.AddChannel(schema, message.topic, "cdr");
  }
  for (const Message& message : messages) {
    const Status status = writer.Write(
        channels.at(message.topic), static_cast<std::uint64_t>(message.log_time_ns), message.data);
    SHIFTMAP_CHECK(status.ok(), "{}", status.ToString());
  }
  SHIFTMAP_CHECK(writer.Finish().ok(), "bag '{}'", path);
}

void ExecuteSql(const std::string& path, const std::string& sql) {
  sqlite3* db = nullptr;
  SHIFTMAP_CHECK(sqlite3_open(path.c_str(), &db) == SQLITE_OK, "{}", path);
  SHIFTMAP_CHECK(sqlite3_exec(db, sql.c_str(), nullptr, nullptr, nullptr) == SQLITE_OK,
                 "{}: {}",
                 sql,
                 sqlite3_errmsg(db));
  sqlite3_close(db);
}

void CopyWhileOpen(const std::string& path, const std::string& sql, const std::string& copy) {
  sqlite3* db = nullptr;
  SHIFTMAP_CHECK(sqlite3_open(path.c_str(), &db) == SQLITE_OK, "{}", path);
  SHIFTMAP_CHECK(sqlite3_exec(db, sql.c_str(), nullptr, nullptr, nullptr) == SQLITE_OK, "{}", sql);
  std::filesystem::copy_file(path, copy);
  std::filesystem::copy_file(path + "-wal", copy + "-wal");
  sqlite3_close(db);
}

void WriteSqliteBag(const std::string& path, const std::vector<Message>& messages) {
  std::string sql =
      "PRAGMA page_size=512; BEGIN;"
      "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,"
      " serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL);"
      "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL,"
      " timestamp INTEGER NOT NULL, data BLOB NOT NULL);";
  std::map<std::string, std::size_t> topics;
  for (const Message& message : messages) {
    if (topics.emplace(message.topic, topics.size() + 1).second) {
      sql += fmt::format("INSERT INTO topics VALUES ({}, '{}', '{}', 'cdr', '');",
                         topics.size(),
                         message.topic,
                         message.type);
    }
    std::string hex;
    for (const char byte : message.data) {
      hex += fmt::format("{:02x}", static_cast<unsigned char>(byte));
    }
    sql += fmt::format("INSERT INTO messages (topic_id, timestamp, data) VALUES ({}, {}, x'{}');",
                       topics.at(message.topic),
                       message.log_time_ns,
                       hex);
  }
  ExecuteSql(path, sql + "COMMIT");
}

}  // namespace shiftmap::rosbag2::testing
