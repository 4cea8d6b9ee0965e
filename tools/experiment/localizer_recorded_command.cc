// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/localizer_recorded_command.h"

#include <fmt/format.h>

#include <array>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "mapper/mapper.h"
#include "tools/convert/utias.h"
#include "tools/experiment/experiment_output.h"
#include "tools/experiment/localizer_recorded.h"
#include "tools/experiment/localizer_utias.h"

namespace shiftmap {
namespace {

struct Arguments {
  std::string data;
  std::string output;
};

struct Recording {
  int dataset = 0;
  int robot = 0;
  Run run;
  std::vector<StampedPose> truth;
  std::map<Signature, Eigen::Vector2d> places;
};

constexpr std::array<double, 6> kBlindSeconds = {0.0, 5.0, 15.0, 25.0, 40.0, 60.0};

// Where a run is cut whose first part is mapped, and whose second part is driven. [s]
constexpr double kCutSeconds = 700.0;

// A run, or a part of it.
StatusOr<Recording> Load(const std::string& data,
                         int dataset,
                         int robot,
                         double start_s = 0.0,
                         std::optional<double> duration_s = std::nullopt) {
  Recording recording{dataset, robot, {}, {}, {}};
  UtiasOptions options;
  options.start_s = start_s;
  options.duration_s = duration_s;
  options.dataset_dir = fmt::format("{}/MRCLAM_Dataset{}", data, dataset);
  options.robot = robot;
  SHIFTMAP_ASSIGN_OR_RETURN(UtiasRun recorded, ReadUtias(options));
  recording.run = std::move(recorded.run);
  SHIFTMAP_ASSIGN_OR_RETURN(recording.truth, ReadUtiasGroundtruth(options.dataset_dir, robot));
  SHIFTMAP_ASSIGN_OR_RETURN(recording.places, ReadUtiasLandmarks(options.dataset_dir));
  return recording;
}

std::string NameOf(const Recording& recording) {
  return fmt::format("{}/{}", recording.dataset, recording.robot);
}

StatusOr<MapSnapshot> MapOf(const std::vector<const Recording*>& recordings) {
  std::vector<MapperInput> inputs;
  for (const Recording* recording : recordings) {
    inputs.push_back({NameOf(*recording), NameOf(*recording), recording->run});
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const MapperResult result,
                            BuildMap(std::move(inputs), std::nullopt, {}));
  return MapSnapshot("utias", VersionNumber(1), "", result.content);
}

// @param vehicle  Whose calibration is used; the fleet's if the map does not know it.
Status AddRow(const MapSnapshot& map,
              const std::string& mapped,
              const Recording& driven,
              double blind_s,
              const std::string& vehicle,
              ResultTable* table) {
  const Run run = WithBlindStretches(driven.run, {.blind_s = blind_s});
  const MapSnapshot calibrated = map.ForVehicle(vehicle);
  SHIFTMAP_ASSIGN_OR_RETURN(const RecordedResult result,
                            LocalizeRecorded(calibrated, run, driven.truth, driven.places));
  table->AddRow({mapped,
                 NameOf(driven),
                 std::string(calibrated.calibrated_vehicle().empty() ? "fleet" : "own"),
                 blind_s,
                 result.start_s,
                 result.rmse_m,
                 result.nees,
                 result.nis,
                 result.lost_s,
                 static_cast<double>(result.decisions),
                 static_cast<double>(result.wrong),
                 static_cast<double>(result.wrong_last)});
  return OkStatus();
}

// A run, and its two parts.
struct CutRecording {
  Recording whole;
  Recording first;
  Recording second;
};

StatusOr<CutRecording> LoadCut(const std::string& data, int dataset, int robot) {
  CutRecording cut;
  SHIFTMAP_ASSIGN_OR_RETURN(cut.whole, Load(data, dataset, robot));
  SHIFTMAP_ASSIGN_OR_RETURN(cut.first, Load(data, dataset, robot, 0.0, kCutSeconds));
  SHIFTMAP_ASSIGN_OR_RETURN(cut.second, Load(data, dataset, robot, kCutSeconds));
  return cut;
}

// The second part of a run on the map of another run and its own first part, with the calibration
// that the map has of its vehicle, and without.
Status AddSecondPart(const Recording& mapped, const CutRecording& driven, ResultTable* table) {
  SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot map, MapOf({&mapped, &driven.first}));
  const std::string& own = driven.second.run.info.vehicle;
  if (map.ForVehicle(own).calibrated_vehicle().empty()) {
    return FailedPrecondition("the first part of {} is not in the map", NameOf(driven.whole));
  }
  const std::string name =
      fmt::format("{} + {} to {:.0f} s", NameOf(mapped), NameOf(driven.whole), kCutSeconds);
  for (const std::string& vehicle : {own, std::string("another")}) {
    SHIFTMAP_RETURN_IF_ERROR(AddRow(map, name, driven.second, 0.0, vehicle, table));
  }
  return OkStatus();
}

Status AddDataset(const std::string& data, const UtiasRobots& recorded, ResultTable* table) {
  std::vector<CutRecording> recordings;
  for (const int robot : recorded.robots) {
    SHIFTMAP_ASSIGN_OR_RETURN(CutRecording recording, LoadCut(data, recorded.dataset, robot));
    recordings.push_back(std::move(recording));
  }
  for (const CutRecording& mapped : recordings) {
    SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot map, MapOf({&mapped.whole}));
    for (const CutRecording& driven : recordings) {
      const Recording& whole = driven.whole;
      if (whole.robot == mapped.whole.robot) continue;
      for (const double blind_s : kBlindSeconds) {
        SHIFTMAP_RETURN_IF_ERROR(
            AddRow(map, NameOf(mapped.whole), whole, blind_s, whole.run.info.vehicle, table));
      }
      SHIFTMAP_RETURN_IF_ERROR(AddSecondPart(mapped.whole, driven, table));
    }
  }
  return OkStatus();
}

Status Measure(const Arguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      ExperimentOutput output,
      ExperimentOutput::Create("localizer-recorded", arguments.output, context.dry_run()));
  const std::unique_ptr<Progress> progress = context.MakeProgress();
  ResultTable table({"map",
                     "driven",
                     "calibration",
                     "blind_s",
                     "start_s",
                     "rmse_m",
                     "nees",
                     "nis",
                     "lost_s",
                     "decisions",
                     "wrong",
                     "wrong_last"});
  for (std::size_t i = 0; i < kUtiasRobots.size(); ++i) {
    progress->Update("runs", static_cast<double>(i) / static_cast<double>(kUtiasRobots.size()));
    SHIFTMAP_RETURN_IF_ERROR(AddDataset(arguments.data, kUtiasRobots[i], &table));
  }
  SHIFTMAP_RETURN_IF_ERROR(output.WritePage(
      "Recorded robots, each on the map of each other one of its data set, and the second part of "
      "each run on the map that has its first part too",
      table));
  return output.Report(Json::object(), table, &context);
}

}  // namespace

void AddLocalizerRecordedExperiment(Application* application) {
  auto arguments = std::make_shared<Arguments>();
  application
      ->AddCommand("localizer-recorded",
                   "Recorded robots on maps of one layout, with stretches without sightings",
                   [arguments](Context& context) { return Measure(*arguments, context); })
      .Option("--data", &arguments->data, "Folder with MRCLAM_Dataset1, 2, 3 and 6")
      .Required()
      .Option("--output", &arguments->output, "Folder for CSV, JSON and a page")
      .Required()
      .Writes();
}

}  // namespace shiftmap
