// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/lidar_run_command.h"

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "tools/convert/lidar_json.h"
#include "tools/eval/trajectory_error.h"
#include "tools/experiment/experiment_output.h"
#include "tools/experiment/lidar_run.h"
#include "tools/experiment/pose_relations.h"

namespace shiftmap {
namespace {

// Scans, some metres: what is wrong locally.
constexpr std::size_t kAlong = 10;

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

struct Arguments {
  std::string data;
  std::string output;
  LidarFrontEndOptions front_end;
  MapperOptions mapper;
  int runs = 5;
};

// A log with what is known of where the vehicle was: nothing, of CSAIL.
struct Drive {
  std::string building;
  std::string figure;  // Its name; empty for none.
  OdometryCalibration odometry;
  int seed = 0;  // Of simulated odometry; 0 where it is the recorded one.
  LidarLog log = {};
  std::vector<StampedPose> corrected = {};
  std::vector<PoseRelation> relations = {};
};

// Noise of odometry that the Intel robot could have had. [m/√s], [rad/√s]
struct OdometryNoise {
  double v;
  double omega;
};
constexpr std::array kSimulated = {
    OdometryNoise{0.03, 0.02}, OdometryNoise{0.02, 0.01}, OdometryNoise{0.01, 0.005}};

StatusOr<std::vector<Drive>> ReadDrives(const Arguments& arguments) {
  const auto in = [&](const char* name) {
    return (std::filesystem::path(arguments.data) / name).string();
  };
  const OdometryCalibration& odometry = arguments.mapper.calibration.odometry;
  Drive intel{.building = "intel", .figure = "intel", .odometry = odometry};
  SHIFTMAP_ASSIGN_OR_RETURN(intel.log, ReadLidarJson(in("intel_gfs.json")));
  SHIFTMAP_ASSIGN_OR_RETURN(LidarLog corrected, ReadLidarJson(in("intel_corrected_log.json")));
  intel.corrected = std::move(corrected.poses);
  SHIFTMAP_ASSIGN_OR_RETURN(intel.relations, ReadPoseRelations(in("intel.relations")));
  Drive csail{.building = "csail", .figure = "csail", .odometry = odometry};
  SHIFTMAP_ASSIGN_OR_RETURN(csail.log, ReadLidarJson(in("csail_gfs.json")));
  std::vector<Drive> drives = {intel, std::move(csail)};
  intel.log.name = "intel, simulated odometry";
  for (const OdometryNoise& noise : kSimulated) {
    for (intel.seed = 1; intel.seed <= arguments.runs; ++intel.seed) {
      intel.figure = intel.seed == 1 ? fmt::format("intel-{}-{}", noise.v, noise.omega) : "";
      intel.odometry.noise_v = noise.v;
      intel.odometry.noise_omega = noise.omega;
      intel.log.poses =
          SimulateOdometry(intel.corrected, intel.odometry, static_cast<std::uint64_t>(intel.seed));
      drives.push_back(intel);
    }
  }
  return drives;
}

Status AddRow(const Drive& drive,
              const ParkResult& result,
              const LidarFrontEndOptions& front_end,
              ResultTable* table) {
  TrajectoryError trajectory;
  trajectory.position_rmse_m = trajectory.position_max_m = trajectory.yaw_rmse_rad = kNone;
  RelationError relation{0, kNone, kNone, kNone, kNone, kNone, kNone};
  RelationError along = relation;
  if (!drive.corrected.empty()) {
    SHIFTMAP_ASSIGN_OR_RETURN(
        trajectory,
        EvaluateTrajectory(result.trajectory, drive.corrected, {.align = true, .max_gap_s = 20.0}));
    SHIFTMAP_ASSIGN_OR_RETURN(relation, EvaluateRelations(result.trajectory, drive.relations));
    SHIFTMAP_ASSIGN_OR_RETURN(
        along, EvaluateRelations(result.trajectory, RelationsAlong(drive.corrected, kAlong)));
  }
  const RevisitMisfit revisits = MeasureRevisits(drive.log, result.trajectory, front_end);
  table->AddRow({drive.building,
                 drive.odometry.noise_v,
                 drive.odometry.noise_omega,
                 static_cast<double>(drive.seed),
                 result.method,
                 static_cast<double>(result.trajectory.size()),
                 trajectory.position_rmse_m,
                 trajectory.position_max_m,
                 trajectory.yaw_rmse_rad,
                 static_cast<double>(relation.matched),
                 relation.translation_mean_m,
                 relation.translation_sd_m,
                 relation.translation_mean_square_m2,
                 relation.rotation_mean_rad,
                 relation.rotation_sd_rad,
                 relation.rotation_mean_square_rad2,
                 along.translation_mean_m,
                 along.rotation_mean_rad,
                 static_cast<double>(revisits.pairs),
                 revisits.median_m,
                 static_cast<double>(result.landmarks.size()),
                 static_cast<double>(result.associated),
                 static_cast<double>(result.observations),
                 result.cpu_s});
  return OkStatus();
}

ResultTable MakeTable() {
  return ResultTable({"building",
                      "noise_v",
                      "noise_omega",
                      "seed",
                      "method",
                      "poses",
                      "rmse_m",
                      "max_m",
                      "yaw_rmse_rad",
                      "relations",
                      "translation_mean_m",
                      "translation_sd_m",
                      "translation_mean_square_m2",
                      "rotation_mean_rad",
                      "rotation_sd_rad",
                      "rotation_mean_square_rad2",
                      "ten_scans_translation_m",
                      "ten_scans_rotation_rad",
                      "revisits",
                      "revisit_median_m",
                      "landmarks",
                      "associated",
                      "observations",
                      "cpu_s"});
}

Status Measure(const Arguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      ExperimentOutput output,
      ExperimentOutput::Create("lidar-run", arguments.output, context.dry_run()));
  const std::unique_ptr<Progress> progress = context.MakeProgress();
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<Drive> drives, ReadDrives(arguments));
  ResultTable table = MakeTable();
  for (std::size_t i = 0; i < drives.size(); ++i) {
    const Drive& drive = drives[i];
    progress->Update(drive.building, static_cast<double>(i) / static_cast<double>(drives.size()));
    SHIFTMAP_ASSIGN_OR_RETURN(const Run run,
                              MakeLidarRun(drive.log, drive.building, arguments.front_end));
    MapperOptions mapper = arguments.mapper;
    mapper.calibration.odometry = drive.odometry;
    SHIFTMAP_ASSIGN_OR_RETURN(std::vector<ParkResult> results, MapLidarRun(run, mapper));
    if (!drive.figure.empty()) {
      SHIFTMAP_RETURN_IF_ERROR(output.WriteFigure(
          drive.figure, DrawLidarMap(drive.log, results.back(), arguments.front_end)));
    }
    if (i == 0) {  // What a good map would have.
      results.push_back({.method = "corrected log", .trajectory = drive.corrected});
    }
    for (const ParkResult& result : results) {
      SHIFTMAP_RETURN_IF_ERROR(AddRow(drive, result, arguments.front_end, &table));
    }
  }
  const AssociationOptions& association = arguments.mapper.association;
  const Json settings{{"min_response", arguments.front_end.points.min_response},
                      {"max_point_range_m", arguments.front_end.max_point_range_m},
                      {"sd_place_m", arguments.front_end.sd_place_m},
                      {"separation_m", association.separation_m},
                      {"min_sightings", association.min_sightings},
                      {"noise_v", arguments.mapper.calibration.odometry.noise_v},
                      {"noise_omega", arguments.mapper.calibration.odometry.noise_omega},
                      {"runs", arguments.runs}};
  return output.Report(settings, table, &context);
}

}  // namespace

void AddLidarRunExperiment(Application* application) {
  auto arguments = std::make_shared<Arguments>();
  arguments->mapper = IndoorOptions();
  AssociationOptions& association = arguments->mapper.association;
  OdometryCalibration& odometry = arguments->mapper.calibration.odometry;
  application
      ->AddCommand("lidar-run",
                   "Buildings mapped by corners that a lidar sees, against a corrected log",
                   [arguments](Context& context) { return Measure(*arguments, context); })
      .Option("--data", &arguments->data, "Folder with the Intel and CSAIL logs")
      .Required()
      .Option("--output", &arguments->output, "Folder for CSV, JSON and SVG")
      .Required()
      .Option("--min-response", &arguments->front_end.points.min_response, "Smallest F of a point")
      .InRange(1e-3, 0.3678)
      .Option("--max-point-range-m",
              &arguments->front_end.max_point_range_m,
              "Points further away are left out")
      .InRange(0.1, 1e4)
      .Option("--sd-place-m", &arguments->front_end.sd_place_m, "Noise of points")
      .InRange(0.0, 1e2)
      .Option("--separation-m", &association.separation_m, "A new landmark's from all others")
      .InRange(0.0, 1e2)
      .Option("--min-sightings", &association.min_sightings, "Of a landmark, at least")
      .InRange(association.confirm_sightings, 1e6)
      .Option("--noise-v", &odometry.noise_v, "Of odometry, to begin with, m per root of s")
      .InRange(1e-4, 10.0)
      .Option("--noise-omega", &odometry.noise_omega, "The same of turns, rad per root of s")
      .InRange(1e-4, 10.0)
      .Option("--runs", &arguments->runs, "With simulated odometry, of each noise")
      .InRange(0, 1000)
      .Writes();
}

}  // namespace shiftmap
