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

StatusOr<Recording> Load(const std::string& data, int dataset, int robot) {
  Recording recording{dataset, robot, {}, {}, {}};
  UtiasOptions options;
  options.dataset_dir = fmt::format("{}/MRCLAM_Dataset{}", data, dataset);
  options.robot = robot;
  SHIFTMAP_ASSIGN_OR_RETURN(UtiasRun recorded, ReadUtias(options));
  recording.run = std::move(recorded.run);
  SHIFTMAP_ASSIGN_OR_RETURN(recording.truth, ReadUtiasGroundtruth(options.dataset_dir, robot));
  SHIFTMAP_ASSIGN_OR_RETURN(recording.places, ReadUtiasLandmarks(options.dataset_dir));
  return recording;
}

StatusOr<MapSnapshot> MapOf(const Recording& recording) {
  const std::string name = fmt::format("{}/{}", recording.dataset, recording.robot);
  SHIFTMAP_ASSIGN_OR_RETURN(const MapperResult result,
                            BuildMap({{name, name, recording.run}}, std::nullopt, {}));
  return MapSnapshot("utias", VersionNumber(1), "", result.content);
}

Status AddRows(const MapSnapshot& map,
               const Recording& mapped,
               const Recording& driven,
               ResultTable* table) {
  for (const double blind_s : kBlindSeconds) {
    const Run run = WithBlindStretches(driven.run, {.blind_s = blind_s});
    SHIFTMAP_ASSIGN_OR_RETURN(
        const RecordedResult result,
        LocalizeRecorded(map.ForVehicle(run.info.vehicle), run, driven.truth, driven.places));
    table->AddRow({fmt::format("{}/{}", mapped.dataset, mapped.robot),
                   fmt::format("{}/{}", driven.dataset, driven.robot),
                   blind_s,
                   result.start_s,
                   result.rmse_m,
                   result.nees,
                   result.nis,
                   result.lost_s,
                   static_cast<double>(result.decisions),
                   static_cast<double>(result.wrong),
                   static_cast<double>(result.wrong_last)});
  }
  return OkStatus();
}

Status AddDataset(const std::string& data, const UtiasRobots& recorded, ResultTable* table) {
  std::vector<Recording> recordings;
  for (const int robot : recorded.robots) {
    SHIFTMAP_ASSIGN_OR_RETURN(Recording recording, Load(data, recorded.dataset, robot));
    recordings.push_back(std::move(recording));
  }
  for (const Recording& mapped : recordings) {
    SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot map, MapOf(mapped));
    for (const Recording& driven : recordings) {
      if (driven.robot != mapped.robot) {
        SHIFTMAP_RETURN_IF_ERROR(AddRows(map, mapped, driven, table));
      }
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
  SHIFTMAP_RETURN_IF_ERROR(output.WriteTable(table));
  SHIFTMAP_RETURN_IF_ERROR(output.WritePage(
      "Recorded robots, each on the map of each other one of its data set", table));
  SHIFTMAP_ASSIGN_OR_RETURN(const Json document, output.WriteDocument(Json::object(), table));
  context.Report(document, table.ToText());
  return OkStatus();
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
