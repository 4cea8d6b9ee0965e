// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/map_consistency_command.h"

#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "mapper/mapper.h"
#include "mapper/parallel.h"
#include "tools/convert/utias.h"
#include "tools/experiment/experiment_output.h"
#include "tools/experiment/map_consistency.h"
#include "tools/sim/open_world.h"

namespace shiftmap {
namespace {

constexpr int kDatasets = 9;
constexpr int kRobots = 5;

struct Arguments {
  std::string data;
  std::string output;
  double duration_s = 0.0;
  int worlds = 20;
  double world_duration_s = 600.0;
  int threads = 1;
  std::uint64_t seed = 1;
};

struct Case {
  std::string name;
  std::vector<MapperInput> runs;
  std::map<Signature, Eigen::Vector2d> places;
};

// The runs of a layout by themselves, each two of them, and all.
void AddMapsOf(const std::string& name,
               const std::vector<MapperInput>& runs,
               const std::map<Signature, Eigen::Vector2d>& places,
               std::vector<Case>* cases) {
  for (std::size_t i = 0; i < runs.size(); ++i) {
    cases->push_back({fmt::format("{} {}", name, runs[i].name), {runs[i]}, places});
    for (std::size_t k = i + 1; k < runs.size(); ++k) {
      cases->push_back(
          {fmt::format("{} {} {}", name, runs[i].name, runs[k].name), {runs[i], runs[k]}, places});
    }
  }
  if (runs.size() > 2) cases->push_back({fmt::format("{} all", name), runs, places});
}

Status AddRecorded(const Arguments& arguments, std::vector<Case>* cases) {
  for (int dataset = 1; dataset <= kDatasets; ++dataset) {
    UtiasOptions options;
    options.dataset_dir = fmt::format("{}/MRCLAM_Dataset{}", arguments.data, dataset);
    if (arguments.duration_s > 0.0) options.duration_s = arguments.duration_s;
    std::vector<MapperInput> runs;
    for (int robot = 1; robot <= kRobots; ++robot) {
      options.robot = robot;
      if (!std::filesystem::exists(
              fmt::format("{}/Robot{}_Measurement.dat", options.dataset_dir, robot))) {
        continue;
      }
      SHIFTMAP_ASSIGN_OR_RETURN(UtiasRun recorded, ReadUtias(options));
      const std::string name = fmt::format("robot {}", robot);
      runs.push_back({name, name, std::move(recorded.run)});
    }
    if (runs.empty()) continue;
    SHIFTMAP_ASSIGN_OR_RETURN(const auto places, ReadUtiasLandmarks(options.dataset_dir));
    AddMapsOf(fmt::format("set {}", dataset), runs, places, cases);
  }
  return OkStatus();
}

Status AddSimulated(const Arguments& arguments, std::vector<Case>* cases) {
  for (int i = 0; i < arguments.worlds; ++i) {
    OpenWorldOptions options;
    options.seed = arguments.seed + static_cast<std::uint64_t>(i);
    options.runs = 2;
    options.modes_per_group = 1;
    options.duration_s = arguments.world_duration_s;
    SHIFTMAP_ASSIGN_OR_RETURN(const SimulatedWorld world, SimulateOpen(options));
    std::vector<MapperInput> runs;
    for (const SimulatedRun& simulated : world.runs) {
      const std::string name = fmt::format("run {}", runs.size());
      runs.push_back({name, name, simulated.run});
    }
    std::map<Signature, Eigen::Vector2d> places;
    for (const SimulatedGroup& group : world.groups) {
      places[group.signature] = group.modes.front();
    }
    AddMapsOf(fmt::format("world {}", options.seed), runs, places, cases);
  }
  return OkStatus();
}

Status Measure(const Arguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      ExperimentOutput output,
      ExperimentOutput::Create("map-consistency", arguments.output, context.dry_run()));
  std::vector<Case> cases;
  if (!arguments.data.empty()) SHIFTMAP_RETURN_IF_ERROR(AddRecorded(arguments, &cases));
  SHIFTMAP_RETURN_IF_ERROR(AddSimulated(arguments, &cases));
  std::vector<std::optional<MapShapeError>> errors(cases.size());
  const std::unique_ptr<Progress> progress = context.MakeProgress();
  ForEachIndex(cases.size(), arguments.threads, [&](std::size_t i) {
    const StatusOr<MapperResult> built = BuildMap(cases[i].runs, std::nullopt, {});
    if (built.ok()) errors[i] = MeasureMapShape(built->content, cases[i].places);
  });
  ResultTable table({"map", "runs", "landmarks", "rms_m", "nees_per_dof"});
  for (std::size_t i = 0; i < cases.size(); ++i) {
    if (!errors[i]) continue;
    table.AddRow({cases[i].name,
                  static_cast<double>(cases[i].runs.size()),
                  static_cast<double>(errors[i]->landmarks),
                  errors[i]->rms_m,
                  errors[i]->nees / errors[i]->dof});
  }
  const Json options{{"duration_s", arguments.duration_s},
                     {"worlds", arguments.worlds},
                     {"world_duration_s", arguments.world_duration_s},
                     {"seed", arguments.seed}};
  return output.Report(options, table, &context);
}

}  // namespace

void AddMapConsistencyExperiment(Application* application) {
  auto arguments = std::make_shared<Arguments>();
  application
      ->AddCommand("map-consistency",
                   "Error of maps of one run, two and more against their covariance",
                   [arguments](Context& context) { return Measure(*arguments, context); })
      .Option("--output", &arguments->output, "Folder for CSV and JSON")
      .Required()
      .Option("--data", &arguments->data, "Folder with MRCLAM_Dataset1 and others; default: none")
      .Option("--duration-s", &arguments->duration_s, "Of recorded runs from their start; 0: all")
      .InRange(0.0, 1e6)
      .Option("--worlds", &arguments->worlds, "Simulated, of two runs each")
      .InRange(0, 100000)
      .Option("--world-duration-s", &arguments->world_duration_s, "Of a simulated run")
      .InRange(10.0, 1e5)
      .Option("--threads", &arguments->threads, "Threads; the results do not depend on it")
      .InRange(1, 64)
      .Option("--seed", &arguments->seed, "Seed of the first world")
      .Writes();
}

}  // namespace shiftmap
