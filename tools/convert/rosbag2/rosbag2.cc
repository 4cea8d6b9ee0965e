// SPDX-License-Identifier: Apache-2.0
#include "tools/convert/rosbag2/rosbag2.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <utility>

#include "mapstore/core/memory_bound.h"
#include "mapstore/core/stamp_check.h"
#include "mapstore/run/trajectory.h"
#include "tools/convert/rosbag2/bag_reader.h"
#include "tools/convert/rosbag2/builtin_definitions.h"
#include "tools/convert/rosbag2/cdr.h"
#include "tools/convert/rosbag2/frame_tree.h"
#include "tools/convert/rosbag2/planar_observation.h"
#include "tools/convert/rosbag2/pose_odometry.h"

namespace shiftmap::rosbag2 {
namespace {

constexpr std::string_view kOdometry = "nav_msgs/Odometry";
constexpr std::string_view kTwistStamped = "geometry_msgs/TwistStamped";
constexpr std::string_view kTransforms = "tf2_msgs/TFMessage";

constexpr double kSidewaysMps = 0.1;
constexpr std::int64_t kMib = 1 << 20;

bool IsOdometryType(const std::string& type) { return type == kOdometry || type == kTwistStamped; }

// The last part of a name: "/robot1/tf_static" is one too.
bool IsTopicNamed(const BagTopic& topic, std::string_view name) {
  return topic.name == name || topic.name.ends_with("/" + std::string(name));
}

using TypeCheck = bool (*)(const std::string& type);

// Names and types, as far as a line holds them.
std::string Listed(const std::vector<const BagTopic*>& topics) {
  constexpr std::size_t kMaxShown = 500;
  std::string text;
  for (const BagTopic* topic : topics) {
    if (text.size() > kMaxShown) break;
    text += fmt::format("{}'{}' ({})", text.empty() ? "" : ", ", topic->name, topic->type);
  }
  if (text.size() > 2 * kMaxShown) text.resize(2 * kMaxShown);
  return text.empty() ? "none" : text;
}

// The topic that was named, or the only one of the types wanted.
StatusOr<const BagTopic*> ChooseTopic(
    const Bag& bag, const std::string& name, TypeCheck fits, const char* what, const char* option) {
  std::vector<const BagTopic*> all;
  std::vector<const BagTopic*> candidates;
  for (const BagTopic& topic : bag.topics()) {
    all.push_back(&topic);
    if (topic.messages > 0 && fits(ShortTypeName(topic.type))) candidates.push_back(&topic);
  }
  if (!name.empty()) {
    for (const BagTopic* topic : candidates) {
      if (topic->name == name) return topic;
    }
    return InvalidArgument("no {} on topic '{}', there is {}", what, name, Listed(candidates));
  }
  if (candidates.size() == 1) return candidates.front();
  if (candidates.empty()) return InvalidArgument("no {}; the topics are {}", what, Listed(all));
  return InvalidArgument(
      "{} on more than one topic, choose by {}: {}", what, option, Listed(candidates));
}

// Decodes messages of topics, whose definitions are parsed once.
class MessageDecoder {
 public:
  Status Add(const BagTopic& topic) {
    const std::string type = ShortTypeName(topic.type);
    if (topic.encoding != "cdr") {
      return InvalidArgument("topic '{}': encoding '{}', expected cdr", topic.name, topic.encoding);
    }
    builtin_ = builtin_ || topic.definition == nullptr;
    auto definition = MessageDefinition::Parse(
        type, topic.definition == nullptr ? BuiltinDefinition(type) : *topic.definition);
    if (!definition.ok()) {
      return InvalidArgument("topic '{}': {}", topic.name, Message(definition.status()));
    }
    definitions_.emplace(&topic, *std::move(definition));
    return OkStatus();
  }

  StatusOr<MessageValue> Decode(const BagMessage& message) const {
    return DecodeCdr(definitions_.at(message.topic), message.data);
  }

  bool builtin() const { return builtin_; }

 private:
  std::map<const BagTopic*, MessageDefinition> definitions_;
  bool builtin_ = false;
};

// Turns one bag into a run.
class Conversion {
 public:
  Conversion(const Bag& bag, const Rosbag2Options& options)
      : bag_(bag), options_(options), max_bytes_(MemoryBound() / 4) {}

  StatusOr<Rosbag2Run> Convert();

 private:
  Status ChooseTopics();
  Status ReadItems();
  Status TakeOdometry(const BagMessage& message, const MessageValue& value);
  Status TakePose(Stamp stamp, const MessageValue& value);
  Status TakeDetections(const BagMessage& message, const MessageValue& value);
  Status ReadTagPositions();
  Status Mount();
  Status MakeScans();
  StatusOr<Stamp> StampOf(const BagMessage& message, Stamp header) const;
  Status CountBytes(std::size_t bytes);
  void Sort();

  const Bag& bag_;
  const Rosbag2Options& options_;
  std::int64_t max_bytes_;
  std::int64_t bytes_ = 0;
  MessageDecoder decoder_;
  const BagTopic* odometry_ = nullptr;
  std::vector<const BagTopic*> detections_;
  std::vector<const BagTopic*> static_transforms_;
  FrameTree frames_;
  std::vector<StampedPose> poses_;    // Of the vehicle in the odometry's frame, if these count.
  std::vector<DetectionScan> scans_;  // With header stamps, which /tf has too,
  std::vector<Stamp> scan_stamps_;    // and the stamps that count.
  Rosbag2Run out_;
};

Status Conversion::CountBytes(std::size_t bytes) {
  bytes_ += static_cast<std::int64_t>(bytes);
  if (bytes_ <= max_bytes_) return OkStatus();
  return InvalidArgument("takes more than {} MiB of memory", max_bytes_ / kMib);
}

Status Conversion::ChooseTopics() {
  SHIFTMAP_ASSIGN_OR_RETURN(
      odometry_,
      ChooseTopic(bag_, options_.odometry_topic, IsOdometryType, "odometry", "--odometry-topic"));
  if (options_.odometry_from_pose && ShortTypeName(odometry_->type) != kOdometry) {
    return InvalidArgument("topic '{}': {} has no pose", odometry_->name, odometry_->type);
  }
  SHIFTMAP_RETURN_IF_ERROR(decoder_.Add(*odometry_));
  out_.odometry_topic = odometry_->name;
  std::vector<std::string> names = options_.detections_topics;
  if (names.empty()) names.emplace_back();
  for (const std::string& name : names) {
    SHIFTMAP_ASSIGN_OR_RETURN(
        const BagTopic* topic,
        ChooseTopic(bag_, name, IsDetectionType, "detections", "--detections-topic"));
    SHIFTMAP_RETURN_IF_ERROR(decoder_.Add(*topic));
    detections_.push_back(topic);
    out_.detections_topics.push_back(topic->name);
  }
  for (const BagTopic& topic : bag_.topics()) {
    if (ShortTypeName(topic.type) != kTransforms || !IsTopicNamed(topic, "tf_static")) continue;
    SHIFTMAP_RETURN_IF_ERROR(decoder_.Add(topic));
    static_transforms_.push_back(&topic);
  }
  return OkStatus();
}

StatusOr<Stamp> Conversion::StampOf(const BagMessage& message, Stamp header) const {
  if (options_.log_time) return message.log_stamp;
  if (header == Stamp()) return InvalidArgument("a header's stamp is 0; try --stamps log");
  return header;
}

Status Conversion::TakeOdometry(const BagMessage& message, const MessageValue& value) {
  const bool twist_only = ShortTypeName(message.topic->type) == kTwistStamped;
  const std::string twist = twist_only ? "twist" : "twist.twist";
  OdometrySample sample;
  SHIFTMAP_ASSIGN_OR_RETURN(const Stamp header, value.Time("header.stamp"));
  SHIFTMAP_ASSIGN_OR_RETURN(sample.stamp, StampOf(message, header));
  if (out_.vehicle_frame.empty()) {
    SHIFTMAP_ASSIGN_OR_RETURN(out_.vehicle_frame,
                              value.Text(twist_only ? "header.frame_id" : "child_frame_id"));
    out_.vehicle_frame = FrameName(std::move(out_.vehicle_frame));
  }
  if (options_.odometry_from_pose) return TakePose(sample.stamp, value);
  SHIFTMAP_ASSIGN_OR_RETURN(sample.v_mps, value.Number(twist + ".linear.x"));
  SHIFTMAP_ASSIGN_OR_RETURN(sample.omega_radps, value.Number(twist + ".angular.z"));
  SHIFTMAP_ASSIGN_OR_RETURN(const double sideways_mps, value.Number(twist + ".linear.y"));
  if (std::abs(sideways_mps) > kSidewaysMps) ++out_.sideways;
  SHIFTMAP_RETURN_IF_ERROR(ValidateEvent(sample));
  out_.run.odometry.push_back(sample);
  return CountBytes(2 * sizeof(OdometrySample));
}

Status Conversion::TakePose(Stamp stamp, const MessageValue& value) {
  SHIFTMAP_RETURN_IF_ERROR(ValidateStamp(stamp));
  SHIFTMAP_ASSIGN_OR_RETURN(const Eigen::Isometry3d T,
                            ReadIsometry(value, "pose.pose.position", "pose.pose.orientation"));
  const double yaw_rad = std::atan2(T.linear()(1, 0), T.linear()(0, 0));
  poses_.push_back({stamp, Se2(T.translation().x(), T.translation().y(), yaw_rad)});
  return CountBytes(2 * (sizeof(StampedPose) + sizeof(OdometrySample)));
}

Status Conversion::TakeDetections(const BagMessage& message, const MessageValue& value) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      DetectionScan scan,
      ReadDetections(ShortTypeName(message.topic->type), value, options_.detections));
  SHIFTMAP_ASSIGN_OR_RETURN(const Stamp stamp, StampOf(message, scan.stamp));
  std::size_t bytes = 2 * (sizeof(DetectionScan) + sizeof(Scan));
  for (const Detection& detection : scan.detections) {
    bytes += sizeof(Detection) + sizeof(Observation) + detection.frame.size() +
             detection.tag_frame.size() + 2 * detection.signature.text().size();
  }
  scans_.push_back(std::move(scan));
  scan_stamps_.push_back(stamp);
  return CountBytes(bytes);
}

Status Conversion::ReadItems() {
  std::vector<const BagTopic*> topics = detections_;
  topics.push_back(odometry_);
  topics.insert(topics.end(), static_transforms_.begin(), static_transforms_.end());
  return bag_.ForEachMessage(topics, [&](const BagMessage& message) -> Status {
    SHIFTMAP_ASSIGN_OR_RETURN(const MessageValue value, decoder_.Decode(message));
    if (message.topic == odometry_) return TakeOdometry(message, value);
    if (ShortTypeName(message.topic->type) != kTransforms) return TakeDetections(message, value);
    SHIFTMAP_ASSIGN_OR_RETURN(const auto transforms, ReadTransforms(value));
    for (const FrameTransform& transform : transforms) {
      SHIFTMAP_RETURN_IF_ERROR(CountBytes(sizeof(FrameTransform)));
      frames_.Add(transform);
    }
    return OkStatus();
  });
}

// A detector of AprilTags sends positions as transforms, of the stamp of the detections.
Status Conversion::ReadTagPositions() {
  std::map<std::pair<std::string, Stamp>, std::vector<Detection*>> wanted;
  for (DetectionScan& scan : scans_) {
    for (Detection& detection : scan.detections) {
      if (!detection.tag_frame.empty())
        wanted[{detection.tag_frame, scan.stamp}].push_back(&detection);
    }
  }
  if (wanted.empty()) return OkStatus();
  std::vector<const BagTopic*> topics;
  for (const BagTopic& topic : bag_.topics()) {
    if (ShortTypeName(topic.type) != kTransforms || !IsTopicNamed(topic, "tf")) continue;
    SHIFTMAP_RETURN_IF_ERROR(decoder_.Add(topic));
    topics.push_back(&topic);
  }
  const auto take = [&](const BagMessage& message) -> Status {
    SHIFTMAP_ASSIGN_OR_RETURN(const MessageValue value, decoder_.Decode(message));
    SHIFTMAP_ASSIGN_OR_RETURN(const auto transforms, ReadTransforms(value));
    for (const FrameTransform& transform : transforms) {
      const auto found = wanted.find({transform.child, transform.stamp});
      if (found == wanted.end()) continue;
      for (Detection* detection : found->second) {
        detection->frame = transform.parent;
        detection->p_frame_landmark = transform.T_parent_child.translation();
        detection->tag_frame.clear();
      }
    }
    return OkStatus();
  };
  return bag_.ForEachMessage(topics, take);
}

// Where each sensor is on the vehicle.
Status Conversion::Mount() {
  if (!options_.vehicle_frame.empty()) out_.vehicle_frame = FrameName(options_.vehicle_frame);
  std::set<std::string> sensors;
  for (const DetectionScan& scan : scans_) {
    for (const Detection& detection : scan.detections) {
      if (detection.tag_frame.empty()) sensors.insert(detection.frame);
    }
  }
  for (const std::string& sensor : sensors) {
    if (options_.mount) {
      out_.T_vehicle_sensor[sensor] = *options_.mount;
      continue;
    }
    const auto T = frames_.Lookup(out_.vehicle_frame, sensor);
    if (!T.ok()) {
      return MakeStatus(T.status().code(),
                        "{}; give --mount, or the vehicle's frame with --vehicle-frame",
                        Message(T.status()));
    }
    out_.T_vehicle_sensor[sensor] = *T;
  }
  return OkStatus();
}

Status Conversion::MakeScans() {
  std::int64_t positions = 0;
  for (std::size_t i = 0; i < scans_.size(); ++i) {
    Scan scan{scan_stamps_[i], {}};
    for (const Detection& detection : scans_[i].detections) {
      if (!detection.tag_frame.empty() || !detection.p_frame_landmark.allFinite()) {
        ++out_.dropped_detections;
        continue;
      }
      ++positions;
      scan.observations.push_back(
          ToPlanar(detection, out_.T_vehicle_sensor.at(detection.frame), options_));
      if (!scan.observations.back().cov_z) ++out_.without_covariance;
    }
    SHIFTMAP_RETURN_IF_ERROR(ValidateEvent(scan));
    out_.run.scans.push_back(std::move(scan));
  }
  if (positions == 0 && out_.dropped_detections > 0) {
    return InvalidArgument(
        "none of {} detections has a position; for AprilTags /tf has it as frame '{}', see "
        "--tag-frame",
        out_.dropped_detections,
        options_.detections.tag_frame);
  }
  return OkStatus();
}

// Recorders write messages as they arrive; a run is in the order of stamps.
void Conversion::Sort() {
  const auto earlier = [](const auto& a, const auto& b) { return a.stamp < b.stamp; };
  const auto sort = [&](auto* items) {
    for (std::size_t i = 1; i < items->size(); ++i) {
      if ((*items)[i].stamp < (*items)[i - 1].stamp) ++out_.late_items;
    }
    std::stable_sort(items->begin(), items->end(), earlier);
  };
  sort(&poses_);
  sort(&out_.run.odometry);
  sort(&out_.run.scans);
  if (options_.odometry_from_pose) out_.run.odometry = OdometryOfPoses(poses_);
}

StatusOr<Rosbag2Run> Conversion::Convert() {
  SHIFTMAP_RETURN_IF_ERROR(ChooseTopics());
  SHIFTMAP_RETURN_IF_ERROR(ReadItems());
  SHIFTMAP_RETURN_IF_ERROR(ReadTagPositions());
  SHIFTMAP_RETURN_IF_ERROR(Mount());
  SHIFTMAP_RETURN_IF_ERROR(MakeScans());
  Sort();
  SHIFTMAP_RETURN_IF_ERROR(ValidateRun(out_.run));
  out_.run.info.vehicle = options_.vehicle;
  out_.run.info.source = "rosbag2";
  out_.run.info.area = options_.area;
  out_.run.info.uuid = options_.run_uuid;
  out_.builtin_definitions = decoder_.builtin();
  out_.truncations = bag_.truncations();
  return std::move(out_);
}

}  // namespace

StatusOr<Rosbag2Run> ReadRosbag2(const Rosbag2Options& options) {
  SHIFTMAP_ASSIGN_OR_RETURN(const Bag bag, Bag::Open(options.path));
  StatusOr<Rosbag2Run> run = Conversion(bag, options).Convert();
  if (run.ok() || Message(run.status()).starts_with("bag '")) return run;
  return Annotate(run.status(), "bag '{}'", options.path);
}

}  // namespace shiftmap::rosbag2
