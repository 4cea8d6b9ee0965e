// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/sim_commands.h"

#include <fmt/format.h>

#include <memory>

#include "mapstore/cli/stop_signals.h"
#include "tools/sim/mine_command.h"
#include "tools/sim/open_world.h"
#include "tools/sim/world_files.h"
#include "tools/sim/world_report.h"

namespace shiftmap {
namespace {

struct OpenArguments {
  std::string directory;
  double start_s = 0.0;
  OpenWorldOptions world;
};

Status RunOpen(OpenArguments arguments, Context& context) {
  const StopSignals signals;
  arguments.world.start = StampFromSeconds(arguments.start_s);
  arguments.world.stopped = [] { return !StopSignals::Received().empty(); };
  const StatusOr<SimulatedWorld> world = SimulateOpen(arguments.world);
  SHIFTMAP_RETURN_IF_ERROR(
      StopSignals::Check(fmt::format("folder '{}': simulation", arguments.directory)));
  SHIFTMAP_RETURN_IF_ERROR(world.status());
  std::vector<std::string> paths;
  if (!context.dry_run()) {
    SHIFTMAP_ASSIGN_OR_RETURN(paths, WriteWorld(*world, arguments.directory));
  }
  ReportWorld(*world, arguments.directory, paths, &context);
  return OkStatus();
}

void AddOptions(OpenArguments* arguments, Command* command) {
  OpenWorldOptions& world = arguments->world;
  arguments->start_s = ToSecondsSinceEpoch(world.start);
  command->Option("DIR", &arguments->directory, "Folder to write to").Required();
  command->Option("--seed", &world.seed, "Seed of everything random");
  command->Option("--groups", &world.groups, "Number of landmarks");
  command->Option("--modes", &world.modes_per_group, "Places per landmark");
  command->Option("--size-m", &world.size_m, "Edge of the floor");
  command->Option("--mode-gap-m", &world.mode_gap_m, "Least distance between two places");
  command->Option("--runs,--shifts", &world.runs, "Number of runs");
  command->Option("--vehicles", &world.vehicles, "Vehicles that take turns");
  command->Option("--duration-s", &world.duration_s, "Length of a run");
  command->Option("--shift-interval-s", &world.shift_interval_s, "From run to run");
  command->Option("--start-s", &arguments->start_s, "Start, seconds since the epoch");
  command->Option("--mode-change-probability",
                  &world.mode_change_probability,
                  "That a landmark moves between two runs");
  command->Option(
      "--absent-probability", &world.absent_probability, "That a landmark is away in a run");
  command->Option("--speed-mps", &world.speed_mps, "Top speed");
  command->Option("--odometry-rate-hz", &world.odometry_rate_hz, "Odometry samples per second");
  command->Option("--scan-rate-hz", &world.scan_rate_hz, "Scans per second");
  command->Option("--odometry-scale-v", &world.odometry.scale_v, "True over logged speed");
  command->Option(
      "--odometry-scale-omega", &world.odometry.scale_omega, "True over logged yaw rate");
  command->Option("--odometry-lag-s", &world.odometry.lag_s, "The motion follows the log by this");
  command->Option("--odometry-noise-v", &world.odometry.noise_v, "Random walk, m per root second");
  command->Option(
      "--odometry-noise-omega", &world.odometry.noise_omega, "Random walk, rad per root second");
  command->Option("--range-sd-m", &world.sensor.sd_range_m, "Noise of a range");
  command->Option("--bearing-sd-rad", &world.sensor.sd_bearing_rad, "Noise of a bearing");
  command->Option("--max-range-m", &world.sensor.max_range_m, "Field of view");
  command->Option("--max-bearing-rad", &world.sensor.max_bearing_rad, "Field of view, half angle");
  command->Option("--detection-probability",
                  &world.sensor.detection_probability,
                  "Of a landmark in the field of view");
  command->Option("--clutter-per-scan", &world.clutter_per_scan, "Expected false observations");
}

}  // namespace

void AddSimCommands(Application* application) {
  auto arguments = std::make_shared<OpenArguments>();
  Command& command = application->AddCommand(
      "open",
      "Simulate shifts on an open floor whose landmarks move, with truth",
      [arguments](Context& context) { return RunOpen(*arguments, context); });
  command.Writes();
  AddOptions(arguments.get(), &command);
  AddMineCommand(application);
}

}  // namespace shiftmap
