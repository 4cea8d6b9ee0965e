// SPDX-License-Identifier: Apache-2.0
#include "tools/convert/convert_commands.h"

#include <memory>
#include <nlohmann/json.hpp>

#include "mapstore/codec/run_log.h"
#include "mapstore/run/trajectory.h"
#include "tools/convert/carmen.h"
#include "tools/convert/check/check_command.h"
#include "tools/convert/csv_command.h"
#include "tools/convert/lidar_json.h"
#include "tools/convert/lidar_log.h"
#include "tools/convert/rosbag2/rosbag2_command.h"
#include "tools/convert/run_report.h"
#include "tools/convert/utias.h"
#include "tools/convert/victoria_park.h"

namespace shiftmap {
namespace {

struct UtiasArguments {
  UtiasOptions options;
  std::string output;
  std::optional<std::string> truth;
};

// The poses of the run's stretch: what lies outside has nothing to be compared with.
StatusOr<std::vector<StampedPose>> ReadTruth(const UtiasOptions& options, const Run& run) {
  SHIFTMAP_ASSIGN_OR_RETURN(const auto all,
                            ReadUtiasGroundtruth(options.dataset_dir, options.robot));
  std::vector<StampedPose> truth;
  for (const StampedPose& pose : all) {
    if (pose.stamp < run.odometry.front().stamp || pose.stamp > run.odometry.back().stamp) continue;
    truth.push_back(pose);
  }
  return truth;
}

Status RunUtias(const UtiasArguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(const UtiasRun utias, ReadUtias(arguments.options));
  const Run& run = utias.run;
  std::vector<StampedPose> truth;
  if (arguments.truth) {
    SHIFTMAP_ASSIGN_OR_RETURN(truth, ReadTruth(arguments.options, run));
  }
  if (!context.dry_run()) {
    SHIFTMAP_RETURN_IF_ERROR(WriteRunLog(run, arguments.output));
    if (arguments.truth) SHIFTMAP_RETURN_IF_ERROR(WriteTum(truth, *arguments.truth));
  }
  Json more = {{"dropped_robot_measurements", utias.robot_measurements},
               {"dropped_unlisted_measurements", utias.unlisted_measurements}};
  if (arguments.truth) more["truth_poses"] = truth.size();
  ReportRun(arguments.output, run, more, context);
  return OkStatus();
}

struct VictoriaParkArguments {
  VictoriaParkOptions options;
  std::string output;
  std::optional<std::string> gps;
};

Status RunVictoriaPark(const VictoriaParkArguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(const VictoriaParkRun park, ReadVictoriaPark(arguments.options));
  // Fixes have no heading; eval aligns positions only.
  std::vector<StampedPose> gps;
  if (arguments.gps) {
    SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<GpsFix> fixes,
                              ReadVictoriaParkGps(arguments.options.dataset_dir));
    for (const GpsFix& fix : fixes) gps.push_back({fix.stamp, Se2(fix.p_gps_antenna, 0.0)});
  }
  const Run& run = park.run;
  if (!context.dry_run()) {
    SHIFTMAP_RETURN_IF_ERROR(WriteRunLog(run, arguments.output));
    if (arguments.gps) SHIFTMAP_RETURN_IF_ERROR(WriteTum(gps, *arguments.gps));
  }
  Json more = {{"dropped_stale_rows", park.stale_rows}};
  if (arguments.gps) more["gps_fixes"] = gps.size();
  ReportRun(arguments.output, run, more, context);
  return OkStatus();
}

void AddVictoriaParkCommand(Application* application) {
  auto arguments = std::make_shared<VictoriaParkArguments>();
  application
      ->AddCommand("victoria-park",
                   "Convert the truck's log of the Victoria Park data set",
                   [arguments](Context& context) { return RunVictoriaPark(*arguments, context); })
      .Writes()
      .Option("DATASET_DIR", &arguments->options.dataset_dir, "Folder with the .csv files")
      .Required()
      .Option("--output", &arguments->output, "Run log to write")
      .Output()
      .Required()
      .Option("--sd-range-m", &arguments->options.sd_range_m, "Noise that ranges are logged with")
      .InRange(1e-3, 1e2)
      .Option("--sd-bearing-rad",
              &arguments->options.sd_bearing_rad,
              "Noise that bearings are logged with")
      .InRange(1e-4, 1.0)
      .Option("--gps", &arguments->gps, "Write the GPS fixes here too, with no heading");
}

void AddUtiasCommand(Application* application) {
  auto arguments = std::make_shared<UtiasArguments>();
  application
      ->AddCommand("utias",
                   "Convert a robot's log of the UTIAS MRCLAM data set",
                   [arguments](Context& context) { return RunUtias(*arguments, context); })
      .Writes()
      .Option("DATASET_DIR", &arguments->options.dataset_dir, "Folder with the .dat files")
      .Required()
      .Option("--robot", &arguments->options.robot, "Number of the robot")
      .Required()
      .InRange(1, 5)
      .Option("--output", &arguments->output, "Run log to write")
      .Output()
      .Required()
      .Option("--start-s", &arguments->options.start_s, "Where to start, from the first sample on")
      .Option("--duration-s", &arguments->options.duration_s, "How long (default: to the end)")
      .Option("--truth", &arguments->truth, "Write the true trajectory of the stretch here too");
}

struct LidarArguments {
  std::string file;
  std::string output;
  std::string vehicle = "lidar";
  std::optional<std::string> poses;
  bool keep_scans = false;
  std::optional<double> field_of_view_rad;
  std::optional<double> max_range_m;
  double lidar_x_m = 0.0;
  double lidar_y_m = 0.0;
  double lidar_yaw_rad = 0.0;
  LidarFrontEndOptions front_end;
};

// What is given counts more than what the log states, and that more than the defaults.
LidarSensor SensorOf(const LidarArguments& arguments, const LidarLog& log) {
  LidarSensor sensor = arguments.front_end.sensor;
  sensor.T_vehicle_lidar = Se2(arguments.lidar_x_m, arguments.lidar_y_m, arguments.lidar_yaw_rad);
  for (const auto& view : {log.field_of_view_rad, arguments.field_of_view_rad}) {
    sensor.field_of_view_rad = view.value_or(sensor.field_of_view_rad);
  }
  for (const auto& range : {log.max_range_m, arguments.max_range_m}) {
    sensor.max_range_m = range.value_or(sensor.max_range_m);
  }
  return sensor;
}

Status RunLidar(const LidarArguments& arguments,
                StatusOr<LidarLog> (*read)(const std::string&),
                Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(const LidarLog log, read(arguments.file));
  LidarFrontEndOptions front_end = arguments.front_end;
  front_end.sensor = SensorOf(arguments, log);
  SHIFTMAP_ASSIGN_OR_RETURN(const Run run,
                            MakeLidarRun(log, arguments.vehicle, front_end, arguments.keep_scans));
  if (!context.dry_run()) {
    SHIFTMAP_RETURN_IF_ERROR(WriteRunLog(run, arguments.output));
    if (arguments.poses) SHIFTMAP_RETURN_IF_ERROR(WriteTum(log.poses, *arguments.poses));
  }
  ReportRun(arguments.output,
            run,
            {{"field_of_view_rad", front_end.sensor.field_of_view_rad},
             {"max_range_m", front_end.sensor.max_range_m},
             {"lidar_scans", run.lidar_scans.size()},
             {"skipped_rows", log.skipped_rows}},
            context);
  return OkStatus();
}

void AddLidarCommand(const std::string& name,
                     const std::string& help,
                     StatusOr<LidarLog> (*read)(const std::string&),
                     Application* application) {
  auto arguments = std::make_shared<LidarArguments>();
  LidarFrontEndOptions& front_end = arguments->front_end;
  application
      ->AddCommand(
          name,
          help,
          [arguments, read](Context& context) { return RunLidar(*arguments, read, context); })
      .Writes()
      .Option("FILE", &arguments->file, "Log with odometry and scans")
      .Required()
      .Option("--output", &arguments->output, "Run log to write")
      .Output()
      .Required()
      .Option("--vehicle", &arguments->vehicle, "Name of the vehicle")
      .Option("--poses", &arguments->poses, "Write the poses that the log states here too")
      .Flag("--keep-scans",
            &arguments->keep_scans,
            "Write the scans too, for shiftmap-localizer --field-of-view scan-polygon")
      .Option("--field-of-view-rad",
              &arguments->field_of_view_rad,
              "From the first beam to the last (default: the log's, else 3.1416)")
      .InRange(1e-3, 6.283)
      .Option("--max-range-m",
              &arguments->max_range_m,
              "Ranges from here on are no return (default: the log's, else 80)")
      .InRange(0.1, 1e4)
      .Option("--lidar-x-m", &arguments->lidar_x_m, "Where the lidar is on the vehicle: forward")
      .InRange(-100.0, 100.0)
      .Option("--lidar-y-m", &arguments->lidar_y_m, "To the left")
      .InRange(-100.0, 100.0)
      .Option("--lidar-yaw-rad", &arguments->lidar_yaw_rad, "Turned counter-clockwise")
      .InRange(-3.1416, 3.1416)
      .Option("--min-response",
              &front_end.points.min_response,
              "Smallest F of a point; lower takes flatter corners")
      .InRange(1e-3, 0.3678)
      .Option("--min-separation-m", &front_end.points.min_separation_m, "Between two points")
      .InRange(0.0, 10.0)
      .Option(
          "--max-point-range-m", &front_end.max_point_range_m, "Points further away are left out")
      .InRange(0.1, 1e4)
      .Option("--sd-range-m", &front_end.sd_range_m, "Noise that points are logged with: ranges")
      .InRange(1e-3, 1e2)
      .Option("--sd-bearing-rad", &front_end.sd_bearing_rad, "Bearings")
      .InRange(1e-4, 1.0)
      .Option("--sd-place-m", &front_end.sd_place_m, "Where on a thing its point is")
      .InRange(0.0, 1e2);
}

}  // namespace

void AddConvertCommands(Application* application) {
  AddRosbag2Command(application);
  AddCsvCommand(application);
  AddCheckCommand(application);
  AddUtiasCommand(application);
  AddVictoriaParkCommand(application);
  AddLidarCommand("lidar-json",
                  "Convert lidar scans and odometry in JSON to landmarks at corners",
                  ReadLidarJson,
                  application);
  AddLidarCommand("carmen",
                  "Convert lidar scans and odometry of a CARMEN log to landmarks at corners",
                  ReadCarmen,
                  application);
}

}  // namespace shiftmap
