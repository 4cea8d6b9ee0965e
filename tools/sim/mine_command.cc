// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/mine_command.h"

#include <fmt/format.h>

#include <memory>
#include <optional>
#include <string_view>

#include "mapstore/cli/stop_signals.h"
#include "tools/convert/decimal.h"
#include "tools/sim/mine_drawing.h"
#include "tools/sim/mine_files.h"
#include "tools/sim/mine_world.h"
#include "tools/sim/world_files.h"
#include "tools/sim/world_report.h"

namespace shiftmap {
namespace {

constexpr const char* kOriginal = "original";
constexpr const char* kModified = "modified";

struct MineArguments {
  std::string directory;
  double start_s = 0.0;
  std::string plan = kOriginal;
  std::string frame = "ex";
  std::string window;
  std::vector<std::string> path;
  double tolerance_m = 0.15;
  bool sign_corners = false;
  int beams = 361;
  double field_of_view_rad = std::numbers::pi;
  double lidar_range_m = 80.0;
  RangeNoise noise;
  MineWorldOptions world;

  bool drawing() const { return plan != kOriginal && plan != kModified; }
};

// `count` numbers between commas, or nothing.
std::optional<std::vector<double>> ParseNumbers(std::string_view text, std::size_t count) {
  std::vector<double> numbers;
  while (true) {
    const std::size_t comma = text.find(',');
    const StatusOr<double> number = ParseNumber(text.substr(0, comma));
    if (!number.ok()) return std::nullopt;
    numbers.push_back(*number);
    if (comma == std::string_view::npos) break;
    text.remove_prefix(comma + 1);
  }
  return numbers.size() == count ? std::optional(numbers) : std::nullopt;
}

std::string CheckArguments(const MineArguments& arguments) {
  for (const std::string& point : arguments.path) {
    if (!ParseNumbers(point, 2)) return fmt::format("--path '{}', expected X,Y", point);
  }
  if (!arguments.window.empty() && !ParseNumbers(arguments.window, 4)) {
    return fmt::format("--window '{}', expected XMIN,YMIN,XMAX,YMAX", arguments.window);
  }
  if (arguments.drawing() && (arguments.window.empty() || arguments.path.size() < 2)) {
    return "a drawing as --plan needs --window, and --path with two points or more";
  }
  if (arguments.sign_corners && (arguments.drawing() || !arguments.world.drive.points)) {
    return "--sign-corners needs --points and a plan that is no drawing";
  }
  return "";
}

std::vector<Eigen::Vector2d> PathOf(const MineArguments& arguments) {
  std::vector<Eigen::Vector2d> path;
  for (const std::string& point : arguments.path) {
    const std::vector<double> xy = *ParseNumbers(point, 2);
    path.emplace_back(xy[0], xy[1]);
  }
  return path;
}

StatusOr<MinePlan> ReadPlan(const MineArguments& arguments) {
  const std::vector<double> window = *ParseNumbers(arguments.window, 4);
  MinePlan plan;
  SHIFTMAP_ASSIGN_OR_RETURN(plan.original,
                            ReadMineDrawing(arguments.plan,
                                            arguments.frame,
                                            {window[0], window[1], window[2], window[3]},
                                            arguments.tolerance_m));
  plan.modified = plan.original;
  return plan;
}

void AddLidars(const MineArguments& arguments, MineDriveOptions* drive) {
  drive->lidars = FrontAndRearLidar();
  for (SimulatedLidar& lidar : drive->lidars) {
    lidar.beams = arguments.beams;
    lidar.sensor.field_of_view_rad = arguments.field_of_view_rad;
    lidar.sensor.max_range_m = arguments.lidar_range_m;
    lidar.noise = arguments.noise;
  }
}

Status RunMine(MineArguments arguments, Context& context) {
  const StopSignals signals;
  MineWorldOptions& options = arguments.world;
  options.stopped = [] { return !StopSignals::Received().empty(); };
  options.drive.start = StampFromSeconds(arguments.start_s);
  options.drive.path = PathOf(arguments);
  options.landmarks.corners = arguments.sign_corners;
  if (options.drive.points || options.drive.log_scans) AddLidars(arguments, &options.drive);
  if (arguments.plan == kModified) options.versions = {PlanVersion::kModified};
  if (arguments.drawing()) {
    SHIFTMAP_ASSIGN_OR_RETURN(options.drawn, ReadPlan(arguments));
  }
  const StatusOr<MineWorld> mine = SimulateMine(options);
  SHIFTMAP_RETURN_IF_ERROR(
      StopSignals::Check(fmt::format("folder '{}': simulation", arguments.directory)));
  SHIFTMAP_RETURN_IF_ERROR(mine.status());
  std::vector<std::string> paths;
  if (!context.dry_run()) {
    SHIFTMAP_ASSIGN_OR_RETURN(paths, WriteWorld(mine->world, arguments.directory));
    SHIFTMAP_RETURN_IF_ERROR(WriteMinePlan(mine->site, arguments.directory));
  }
  ReportWorld(mine->world, arguments.directory, paths, &context);
  return OkStatus();
}

void AddPlanOptions(MineArguments* arguments, Command* command) {
  MinePlanOptions& plan = arguments->world.plan;
  command->Option("--plan",
                  &arguments->plan,
                  "original, modified (a drawpoint longer, a corner moved), or the georeference "
                  "(JSON) of a drawing");
  command->Option("--frame", &arguments->frame, "Of a drawing: the name of its frame of reference");
  command->Option(
      "--window", &arguments->window, "Of a drawing: XMIN,YMIN,XMAX,YMAX of what is read, in m");
  command->Option("--path", &arguments->path, "Points X,Y that vehicles pass, else the drift's");
  command->Option("--tolerance-m", &arguments->tolerance_m, "Of a drawing: walls are off by this");
  command->Option("--length-m", &plan.length_m, "Length of the drift");
  command->Option("--drawpoints", &plan.drawpoints, "Along the drift");
  command->Option("--crosscuts", &plan.crosscuts, "To the second drift");
  command->Option("--width-m", &plan.width_m, "Of drifts and crosscuts");
  command->Option("--roughness-m", &plan.roughness_m, "Standard deviation of the walls' bends");
}

void AddLandmarkOptions(MineWorldOptions* world, Command* command) {
  MineLandmarkOptions& landmarks = world->landmarks;
  command->Option("--places-per-barrier",
                  &landmarks.places_per_barrier,
                  "Drawpoints that a barrier is hung at in turn");
  command->Option("--tags", &landmarks.tags, "Tags on walls");
  command->Option("--places-per-tag", &landmarks.places_per_tag, "Places of a tag");
  command->Option("--mode-gap-m", &landmarks.place_gap_m, "Least distance of two places of tags");
  command->Option("--mode-change-probability",
                  &world->mode_change_probability,
                  "That a landmark moves between two runs");
  command->Option(
      "--absent-probability", &world->absent_probability, "That a landmark is away in a run");
}

void AddVehicleOptions(MineDriveOptions* drive, Command* command) {
  command->Option("--speed-mps", &drive->driver.speed_mps, "Top speed");
  command->Option("--legs", &drive->driver.legs, "Drives along the path: there, backwards, ...");
  command->Flag("--from-top", &drive->driver.from_end, "Start at the end of the path");
  command->Option("--odometry-rate-hz", &drive->odometry_rate_hz, "Odometry samples per second");
  command->Option("--scan-rate-hz", &drive->scan_rate_hz, "Scans per second");
  command->Option("--odometry-scale-v", &drive->odometry.scale_v, "True over logged speed");
  command->Option(
      "--odometry-scale-omega", &drive->odometry.scale_omega, "True over logged yaw rate");
  command->Option("--odometry-lag-s", &drive->odometry.lag_s, "The motion follows the log by this");
  command->Option("--odometry-noise-v", &drive->odometry.noise_v, "Random walk, m per root second");
  command->Option(
      "--odometry-noise-omega", &drive->odometry.noise_omega, "Random walk, rad per root second");
  command->Option(
      "--odometry-white-v-mps", &drive->odometry_noise.sd_v_mps, "White noise of the logged speed");
  command->Option("--odometry-white-omega-radps",
                  &drive->odometry_noise.sd_omega_radps,
                  "White noise of the logged yaw rate");
}

void AddSensorOptions(MineArguments* arguments, Command* command) {
  MineDriveOptions& drive = arguments->world.drive;
  command->Option("--range-sd-m", &drive.tag_sensor.sd_range_m, "Noise of a tag's range");
  command->Option("--bearing-sd-rad", &drive.tag_sensor.sd_bearing_rad, "Noise of its bearing");
  command->Option("--max-range-m", &drive.tag_sensor.max_range_m, "Field of view of tags");
  command->Option(
      "--max-bearing-rad", &drive.tag_sensor.max_bearing_rad, "Field of view of tags, half angle");
  command->Option(
      "--detection-probability", &drive.tag_sensor.detection_probability, "Of a tag in view");
  command->Option("--clutter-per-scan", &drive.clutter_per_scan, "Expected false observations");
  command->Flag("--points",
                &drive.points,
                "Log the corners that a front and a rear lidar see, without signature");
  command->Flag("--keep-scans", &drive.log_scans, "Log the scans of the front lidar");
  command->Flag("--sign-corners",
                &arguments->sign_corners,
                "Corners that the plans have apart get signatures");
  command->Option("--lidar-beams", &arguments->beams, "Per lidar");
  command->Option("--lidar-field-of-view-rad", &arguments->field_of_view_rad, "Of each lidar");
  command->Option("--lidar-max-range-m", &arguments->lidar_range_m, "Of each lidar");
  command->Option("--lidar-sd-m", &arguments->noise.base_sd_m, "Noise of a short range");
  command->Option("--lidar-sd-per-m", &arguments->noise.sd_per_m, "More noise per metre of range");
}

}  // namespace

void AddMineCommand(Application* application) {
  auto arguments = std::make_shared<MineArguments>();
  MineWorldOptions& world = arguments->world;
  arguments->start_s = ToSecondsSinceEpoch(world.drive.start);
  Command& command = application->AddCommand(
      "mine",
      "Simulate shifts of loaders in a mine whose barriers and tags move, with truth",
      [arguments](Context& context) { return RunMine(*arguments, context); });
  command.Writes();
  command.Option("DIR", &arguments->directory, "Folder to write to").Required();
  command.Option("--seed", &world.seed, "Seed of everything random");
  command.Option("--runs,--shifts", &world.runs, "Number of runs");
  command.Option("--vehicles", &world.vehicles, "Vehicles that take turns");
  command.Option("--shift-interval-s", &world.shift_interval_s, "From run to run");
  command.Option("--start-s", &arguments->start_s, "Start, seconds since the epoch");
  AddPlanOptions(arguments.get(), &command);
  AddLandmarkOptions(&world, &command);
  AddVehicleOptions(&world.drive, &command);
  AddSensorOptions(arguments.get(), &command);
  command.Check([arguments] { return CheckArguments(*arguments); });
}

}  // namespace shiftmap
