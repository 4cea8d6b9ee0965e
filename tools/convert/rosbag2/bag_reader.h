// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "mapstore/core/stamp.h"
#include "proto/core/status.h"
#include "tools/convert/rosbag2/bag_files.h"

namespace shiftmap::rosbag2 {

/// One topic of a bag.
struct BagTopic {
  std::string name;
  std::string type;      ///< "nav_msgs/msg/Odometry".
  std::string encoding;  ///< Of its messages: "cdr".
  /// Its type in the form of MessageDefinition::Parse(), shared by topics; null if the bag has
  /// none.
  std::shared_ptr<const std::string> definition;
  std::int64_t messages = 0;
};

/// One message, as recorded.
struct BagMessage {
  const BagTopic* topic = nullptr;
  Stamp log_stamp;        ///< When it was recorded.
  std::string_view data;  ///< Valid during the call only.
};

/// A bag that ROS 2 recorded: one or more MCAP files or SQLite files, compressed as files, chunks,
/// messages or not at all. Files are only read, and nothing is made beside them.
///
/// Errors, of every function: kNotFound if a file is missing; kInvalidArgument, kDataLoss,
/// kFailedPrecondition for a file that is not of a bag; kUnavailable if it cannot be read. Messages
/// start with `bag 'FILE': `.
class Bag {
 public:
  /// Reads each file once to list its topics.
  static StatusOr<Bag> Open(const std::string& path);

  /// By name.
  const std::vector<BagTopic>& topics() const { return topics_; }

  /// Gives all messages of some topics, in the order in which they were recorded.
  /// Errors also: the first of `take`.
  Status ForEachMessage(const std::vector<const BagTopic*>& topics,
                        const std::function<Status(const BagMessage&)>& take) const;

  /// For each file that ends early, as after a power failure, where it does.
  const std::vector<std::string>& truncations() const { return truncations_; }

 private:
  struct OpenFile {
    BagFile file;
    std::string path;  ///< Of the file itself, or of its copy without compression.
    bool copied = false;
  };

  Status AddFile(const BagFile& file);
  Status ListMcap(const OpenFile& file);
  Status ListSqlite(const OpenFile& file);
  Status AddTopic(BagTopic topic);

  using Take = std::function<Status(const BagMessage&)>;
  Status ReadMcap(const OpenFile& file,
                  const std::vector<const BagTopic*>& topics,
                  const Take& take) const;
  Status ReadSqlite(const OpenFile& file,
                    const std::vector<const BagTopic*>& topics,
                    const Take& take) const;

  std::vector<OpenFile> files_;
  std::vector<ScratchCopy> copies_;
  std::vector<BagTopic> topics_;
  std::vector<std::string> truncations_;
};

}  // namespace shiftmap::rosbag2
