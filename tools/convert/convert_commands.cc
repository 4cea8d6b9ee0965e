// SPDX-License-Identifier: Apache-2.0
#include "tools/convert/convert_commands.h"

#include <memory>
#include <nlohmann/json.hpp>

#include "mapstore/codec/run_log.h"
#include "mapstore/run/trajectory.h"
#include "tools/convert/utias.h"
#include "tools/convert/victoria_park.h"

namespace shiftmap {
namespace {

// What was written, with what is said of this kind of log alone.
void ReportRun(const std::string& output, const Run& run, const Json& more, Context& context) {
  std::size_t observations = 0;
  for (const Scan& scan : run.scans) observations += scan.observations.size();
  const double duration_s = ToSeconds(run.odometry.back().stamp - run.odometry.front().stamp);
  Json document = {{"output", output},
                   {"source", run.info.source},
                   {"begin_s", ToSecondsSinceEpoch(run.odometry.front().stamp)},
                   {"duration_s", duration_s},
                   {"odometry", run.odometry.size()},
                   {"scans", run.scans.size()},
                   {"observations", observations}};
  document.update(more);
  context.Report(document,
                 fmt::format("{}: {:.1f} s, {} odometry samples, {} scans with {} observations\n",
                             output,
                             duration_s,
                             run.odometry.size(),
                             run.scans.size(),
                             observations));
}

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
      .Required()
      .Option("--start-s", &arguments->options.start_s, "Where to start, from the first sample on")
      .Option("--duration-s", &arguments->options.duration_s, "How long (default: to the end)")
      .Option("--truth", &arguments->truth, "Write the true trajectory of the stretch here too");
}

}  // namespace

void AddConvertCommands(Application* application) {
  AddUtiasCommand(application);
  AddVictoriaParkCommand(application);
}

}  // namespace shiftmap
