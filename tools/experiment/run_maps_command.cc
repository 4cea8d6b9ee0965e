// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/run_maps_command.h"

#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "mapper/parallel.h"
#include "tools/convert/utias.h"
#include "tools/experiment/experiment_output.h"
#include "tools/experiment/run_maps.h"
#include "tools/sim/open_world.h"

namespace shiftmap {
namespace {

constexpr int kDatasets = 9;
constexpr int kRobots = 5;

struct Arguments {
  std::string data;
  std::string output;
  double stretch_s = 0.0;
  int worlds = 20;
  double world_duration_s = 600.0;
  int threads = 1;
  std::uint64_t seed = 1;
};

struct Case {
  std::string name;
  Run run;
  std::map<Signature, Eigen::Vector2d> places;
};

// The recorded runs that are there, whole or cut into stretches.
Status AddRecorded(const Arguments& arguments, std::vector<Case>* cases) {
  for (int dataset = 1; dataset <= kDatasets; ++dataset) {
    for (int robot = 1; robot <= kRobots; ++robot) {
      UtiasOptions options;
      options.dataset_dir = fmt::format("{}/MRCLAM_Dataset{}", arguments.data, dataset);
      options.robot = robot;
      if (!std::filesystem::exists(
              fmt::format("{}/Robot{}_Measurement.dat", options.dataset_dir, robot))) {
        continue;
      }
      SHIFTMAP_ASSIGN_OR_RETURN(const auto places, ReadUtiasLandmarks(options.dataset_dir));
      SHIFTMAP_ASSIGN_OR_RETURN(UtiasRun whole, ReadUtias(options));
      const double duration_s =
          ToSeconds(whole.run.odometry.back().stamp - whole.run.odometry.front().stamp);
      if (arguments.stretch_s <= 0.0) {
        cases->push_back(
            {fmt::format("set {} robot {}", dataset, robot), std::move(whole.run), places});
        continue;
      }
      options.duration_s = arguments.stretch_s;
      for (double start_s = 0.0; start_s + arguments.stretch_s <= duration_s;
           start_s += arguments.stretch_s) {
        options.start_s = start_s;
        SHIFTMAP_ASSIGN_OR_RETURN(UtiasRun stretch, ReadUtias(options));
        cases->push_back({fmt::format("set {} robot {} from {:.0f} s", dataset, robot, start_s),
                          std::move(stretch.run),
                          places});
      }
    }
  }
  return OkStatus();
}

Status AddSimulated(const Arguments& arguments, std::vector<Case>* cases) {
  for (int i = 0; i < arguments.worlds; ++i) {
    OpenWorldOptions options;
    options.seed = arguments.seed + static_cast<std::uint64_t>(i);
    options.runs = 1;
    options.duration_s = arguments.world_duration_s;
    SHIFTMAP_ASSIGN_OR_RETURN(SimulatedWorld world, SimulateOpen(options));
    Case simulated{fmt::format("world {}", options.seed), std::move(world.runs[0].run), {}};
    for (std::size_t g = 0; g < world.groups.size(); ++g) {
      const ModeNumber mode = world.runs[0].active_mode[g];
      if (mode == kAbsent) continue;
      simulated.places[world.groups[g].signature] =
          world.groups[g].modes[static_cast<std::size_t>(mode.value() - 1)];
    }
    cases->push_back(std::move(simulated));
  }
  return OkStatus();
}

Status Measure(const Arguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      ExperimentOutput output,
      ExperimentOutput::Create("run-maps", arguments.output, context.dry_run()));
  std::vector<Case> cases;
  if (!arguments.data.empty()) SHIFTMAP_RETURN_IF_ERROR(AddRecorded(arguments, &cases));
  SHIFTMAP_RETURN_IF_ERROR(AddSimulated(arguments, &cases));
  std::vector<std::optional<RunMapError>> errors(cases.size());
  const std::unique_ptr<Progress> progress = context.MakeProgress();
  ForEachIndex(cases.size(), arguments.threads, [&](std::size_t i) {
    errors[i] = MeasureRunMap(cases[i].run, cases[i].places, {});
  });
  ResultTable table(
      {"run", "landmarks", "rms_m", "nees_per_dof", "variance_factor", "nees_per_dof_raised"});
  for (std::size_t i = 0; i < cases.size(); ++i) {
    if (!errors[i]) continue;
    const double nees = errors[i]->nees / errors[i]->dof;
    table.AddRow({cases[i].name,
                  static_cast<double>(errors[i]->landmarks),
                  errors[i]->rms_m,
                  nees,
                  errors[i]->variance_factor,
                  nees / errors[i]->variance_factor});
  }
  SHIFTMAP_RETURN_IF_ERROR(output.WriteTable(table));
  const Json options{{"stretch_s", arguments.stretch_s},
                     {"worlds", arguments.worlds},
                     {"world_duration_s", arguments.world_duration_s},
                     {"seed", arguments.seed}};
  SHIFTMAP_ASSIGN_OR_RETURN(const Json document, output.WriteDocument(options, table));
  context.Report(document, table.ToText());
  return OkStatus();
}

}  // namespace

void AddRunMapsExperiment(Application* application) {
  auto arguments = std::make_shared<Arguments>();
  application
      ->AddCommand("run-maps",
                   "Error of runs mapped by themselves against their covariance",
                   [arguments](Context& context) { return Measure(*arguments, context); })
      .Option("--output", &arguments->output, "Folder for CSV and JSON")
      .Required()
      .Option("--data", &arguments->data, "Folder with MRCLAM_Dataset1 and others; default: none")
      .Option("--stretch-s", &arguments->stretch_s, "Cut recorded runs into these; 0: whole runs")
      .InRange(0.0, 1e6)
      .Option("--worlds", &arguments->worlds, "Simulated runs, a world each")
      .InRange(0, 100000)
      .Option("--world-duration-s", &arguments->world_duration_s, "Of a simulated run")
      .InRange(10.0, 1e5)
      .Option("--threads", &arguments->threads, "Threads; the results do not depend on it")
      .InRange(1, 64)
      .Option("--seed", &arguments->seed, "Seed of the first world")
      .Writes();
}

}  // namespace shiftmap
