// SPDX-License-Identifier: Apache-2.0
#include "tools/convert/rosbag2/rosbag2_command.h"

#include <memory>
#include <nlohmann/json.hpp>

#include "mapstore/codec/run_log.h"
#include "tools/convert/decimal.h"
#include "tools/convert/rosbag2/rosbag2.h"
#include "tools/convert/run_report.h"

namespace shiftmap {
namespace {

using rosbag2::CovarianceModel;
using rosbag2::Rosbag2Options;
using rosbag2::Rosbag2Run;

struct Rosbag2Arguments {
  Rosbag2Options options;
  std::string output;
  std::string mount;
  std::string stamps = "header";
  std::string position = "pose";
  std::string covariance = "project";
};

// "X,Y,YAW" or "X,Y,Z,ROLL,PITCH,YAW"; the angles as ROS has them, about fixed axes.
StatusOr<Eigen::Isometry3d> ParseMount(const std::string& text) {
  std::vector<double> numbers;
  for (std::size_t begin = 0; begin <= text.size();) {
    const std::size_t end = std::min(text.find(',', begin), text.size());
    SHIFTMAP_ASSIGN_OR_RETURN(const double number, ParseNumber(text.substr(begin, end - begin)));
    numbers.push_back(number);
    begin = end + 1;
  }
  if (numbers.size() == 3) numbers = {numbers[0], numbers[1], 0.0, 0.0, 0.0, numbers[2]};
  if (numbers.size() != 6) {
    return InvalidArgument("'{}', expected X,Y,YAW or X,Y,Z,ROLL,PITCH,YAW", text);
  }
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = (Eigen::AngleAxisd(numbers[5], Eigen::Vector3d::UnitZ()) *
                Eigen::AngleAxisd(numbers[4], Eigen::Vector3d::UnitY()) *
                Eigen::AngleAxisd(numbers[3], Eigen::Vector3d::UnitX()))
                   .toRotationMatrix();
  T.translation() = Eigen::Vector3d(numbers[0], numbers[1], numbers[2]);
  return T;
}

CovarianceModel ModelOf(const std::string& name) {
  if (name == "none") return CovarianceModel::kNone;
  if (name == "fixed") return CovarianceModel::kFixed;
  if (name == "range-bearing") return CovarianceModel::kRangeBearing;
  return CovarianceModel::kProject;
}

Json MountsOf(const Rosbag2Run& bag, bool given) {
  Json mounts = Json::array();
  for (const auto& [frame, T] : bag.T_vehicle_sensor) {
    // Where the sensor's x axis points to; of a camera's optical frame, its z axis looks forward.
    const Eigen::Vector3d x_axis = T.linear().col(0);
    mounts.push_back({{"frame", frame},
                      {"x_m", T.translation().x()},
                      {"y_m", T.translation().y()},
                      {"z_m", T.translation().z()},
                      {"x_axis", {x_axis.x(), x_axis.y(), x_axis.z()}},
                      {"from", given ? "--mount" : "/tf_static"}});
  }
  return mounts;
}

void WarnOf(const Rosbag2Run& bag, const Context& context) {
  for (const std::string& truncation : bag.truncations) context.Warn(truncation);
  if (bag.dropped_detections > 0) {
    context.Warn(
        fmt::format("{} detections without a position are left out", bag.dropped_detections));
  }
  if (bag.sideways > 0) {
    context.Warn(fmt::format(
        "{} odometry messages have a velocity to the side, which a run log does not hold",
        bag.sideways));
  }
  if (bag.builtin_definitions) {
    context.Warn(
        "the bag does not define its messages: they are read as of ROS 2 Humble and later");
  }
}

Status RunRosbag2(const Rosbag2Arguments& arguments, Context& context) {
  Rosbag2Options options = arguments.options;
  if (!arguments.mount.empty()) {
    SHIFTMAP_ASSIGN_OR_RETURN(options.mount, ParseMount(arguments.mount));
  }
  options.log_time = arguments.stamps == "log";
  options.detections.position_from_box = arguments.position == "box";
  options.covariance = ModelOf(arguments.covariance);
  SHIFTMAP_ASSIGN_OR_RETURN(const Rosbag2Run bag, rosbag2::ReadRosbag2(options));
  WarnOf(bag, context);
  if (!context.dry_run()) SHIFTMAP_RETURN_IF_ERROR(WriteRunLog(bag.run, arguments.output));
  ReportRun(arguments.output,
            bag.run,
            {{"odometry_topic", bag.odometry_topic},
             {"detections_topics", bag.detections_topics},
             {"vehicle_frame", bag.vehicle_frame},
             {"mounts", MountsOf(bag, options.mount.has_value())},
             {"definitions", bag.builtin_definitions ? "built in" : "bag"},
             {"late_items", bag.late_items},
             {"dropped_detections", bag.dropped_detections},
             {"without_covariance", bag.without_covariance},
             {"truncated", !bag.truncations.empty()}},
            context);
  return OkStatus();
}

void AddInputOptions(Rosbag2Options* options, Command* command) {
  command->Option("--odometry-topic", &options->odometry_topic, "Default: the only one there is")
      .Flag("--odometry-from-pose",
            &options->odometry_from_pose,
            "Differences of an Odometry's poses, not its twist")
      .Option("--detections-topic",
              &options->detections_topics,
              "Also several times, of several sensors (default: the only one there is)")
      .Option("--vehicle-frame",
              &options->vehicle_frame,
              "Frame of the vehicle (default: the one that the odometry is in)")
      .Option("--signature",
              &options->detections.signature,
              "Landmark's name, of {class_id} and {id}, {id}, or {family} and {id} (default: "
              "{class_id}, {id}, {family}:{id})")
      .Option("--tag-frame", &options->detections.tag_frame, "Frame of an AprilTag on /tf");
}

void AddNoiseOptions(Rosbag2Arguments* arguments, Command* command) {
  command
      ->Option("--covariance", &arguments->covariance, "Of observations, project: the detections'")
      .OneOf({"project", "none", "fixed", "range-bearing"})
      .Option("--sd-m", &arguments->options.sd_m, "Of --covariance fixed")
      .InRange(1e-4, 1e2)
      .Option("--sd-range-m", &arguments->options.sd_range_m, "Of --covariance range-bearing")
      .InRange(1e-4, 1e2)
      .Option(
          "--sd-bearing-rad", &arguments->options.sd_bearing_rad, "Of --covariance range-bearing")
      .InRange(1e-5, 1.0);
}

}  // namespace

void AddRosbag2Command(Application* application) {
  auto arguments = std::make_shared<Rosbag2Arguments>();
  Command& command = application->AddCommand(
      "rosbag2",
      "Convert a bag of ROS 2: odometry, detections and mounting",
      [arguments](Context& context) { return RunRosbag2(*arguments, context); });
  command.Writes()
      .Option("BAG", &arguments->options.path, "Folder of the bag, or one .mcap or .db3 file")
      .Required()
      .Option("--output", &arguments->output, "Run log to write")
      .Output()
      .Required()
      .Option("--vehicle", &arguments->options.vehicle, "Name of the vehicle, unique in the fleet")
      .Option("--area", &arguments->options.area, "Area that the run is in")
      .Option("--run-uuid",
              &arguments->options.run_uuid,
              "Identity of the run (default: none, the log's hash counts)")
      .Option("--stamps", &arguments->stamps, "Where stamps come from")
      .OneOf({"header", "log"})
      .Option("--position", &arguments->position, "Of a Detection3D: its pose, or its box")
      .OneOf({"pose", "box"})
      .Option("--mount",
              &arguments->mount,
              "Sensor on the vehicle, X,Y,YAW or X,Y,Z,ROLL,PITCH,YAW in m and rad (default: "
              "/tf_static)")
      .Check([arguments] {
        if (arguments->mount.empty()) return std::string();
        const auto mount = ParseMount(arguments->mount);
        return mount.ok() ? std::string() : "--mount: " + Message(mount.status());
      });
  AddInputOptions(&arguments->options, &command);
  AddNoiseOptions(arguments.get(), &command);
}

}  // namespace shiftmap
