// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <charconv>
#include <chrono>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "mapper/cli/area_build.h"
#include "mapper/cli/build_report.h"
#include "mapper/cli/build_warnings.h"
#include "mapper/cli/commands.h"
#include "mapper/selection/selector.h"
#include "mapstore/cli/stop_signals.h"
#include "mapstore/core/ids.h"

namespace shiftmap {
namespace {

std::vector<std::string> SelectorNames() {
  std::vector<std::string> names;
  for (const SelectorKind kind : AllSelectors()) names.push_back(SelectorName(kind));
  return names;
}

bool IsPriorName(const std::string& text) {
  if (text == "published" || text == "none") return true;
  VersionNumber::Value number = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  return error == std::errc() && end == text.data() + text.size() && number > 0;
}

bool HasTreeOptions(const AreaBuildOptions& options) {
  const AreaBuildOptions defaults;
  return options.tree.max_leaves != defaults.tree.max_leaves ||
         options.tree.alpha != defaults.tree.alpha || options.tree.update_ungated ||
         options.tree.transform_alternative || options.tree_insertion != defaults.tree_insertion ||
         options.tree_merging != defaults.tree_merging;
}

Status Build(const AreaBuildOptions& options, Context& context) {
  const auto begin = std::chrono::steady_clock::now();
  const StopSignals signals;
  SHIFTMAP_ASSIGN_OR_RETURN(const AreaBuild build, BuildArea(options, context));
  WarnOfRuns(build, context);
  Json document =
      BuildJson(options.area, build.result, build.dropped, build.not_given, build.commit);
  document["selector"] = options.selector;
  document["at_two_places"] = build.at_two_places;
  document["reports_set_aside"] = build.reports_set_aside;
  document["wall_s"] =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  context.Report(document, BuildText(build.result, build.commit));
  if (!build.result.runs.empty()) return OkStatus();
  return MakeStatus(
      StatusCode::kAlreadyExists, "area '{}': every run waits, no version is made", options.area);
}

}  // namespace

void AddBuildCommand(Application* application) {
  auto options = std::make_shared<AreaBuildOptions>();
  Command& command = application->AddCommand(
      "build", "Build a map version from run logs", [options](Context& context) {
        return Build(*options, context);
      });
  AddLimitOptions(&options->limits, &command);
  AddClockToleranceOption(&options->clock_tolerance_s, &command);
  command.Option("--store", &options->store, "Map store; made if there is none")
      .Required()
      .Option("--area", &options->area, "Area to make a version of")
      .Required()
      .Option("--selector", &options->selector, "Engine graph: how the mode of a visit is chosen")
      .OneOf(SelectorNames())
      .Option("--engine", &options->engine, "How the map is estimated")
      .OneOf({"graph", "tree"})
      .Option("--solver",
              &options->solver,
              "Engine graph: what solves it, Gauss-Newton on eliminated chains of poses, or Ceres; "
              "the map is the same to a millimetre")
      .OneOf({"schur", "ceres"})
      .Option("--field-of-view",
              &options->field_of_view,
              "Engine tree: where a landmark that is not seen counts as missed, in the sensor's "
              "sector, or in what of it the last lidar scan covers")
      .OneOf(FieldOfViewNames())
      .Option("--tree-leaves", &options->tree.max_leaves, "Engine tree: leaves kept at most")
      .InRange(1, 1000)
      .Option("--tree-alpha",
              &options->tree.alpha,
              "Engine tree: accepted probability of a wrong decision")
      .InRange(1e-12, 0.49)
      .Flag("--tree-update-ungated",
            &options->tree.update_ungated,
            "Engine tree: what gates with no mode may also correct the mode that a leaf holds")
      .Flag("--tree-transform",
            &options->tree.transform_alternative,
            "Engine tree: a landmark that was absent is at the first place where it is seen")
      .Option("--tree-insertion",
              &options->tree_insertion,
              "Engine tree: a new mode holds since the begin of the visit, or is a child of the "
              "leaf that found it")
      .OneOf({"back-track", "child"})
      .Option("--tree-merging",
              &options->tree_merging,
              "Engine tree: of two leaves that are alike the heavier stays, their mixture, or both")
      .OneOf({"heavier", "mixture", "none"})
      .Option("--prior", &options->prior, "Map to start from: published, none, or a version number")
      .Option("--anonymous",
              &options->anonymous,
              "Observations without a signature: leave them out, or associate them jointly")
      .OneOf({"ignore", "associate"})
      .Option(
          "--placement",
          &options->placement,
          "Engine graph: where a run lies that few landmarks tie to the map, only where no other "
          "explanation is likely, and else it waits, or where most agree")
      .OneOf({"posterior", "consensus"})
      .Flag("--no-publish", &options->no_publish, "Add the version, but publish it later")
      .Flag("--no-calibration",
            &options->no_calibration,
            "Take odometry and sensors at their default calibration")
      .Flag("--no-learned-rates",
            &options->no_learned_rates,
            "Leave the rates of known landmarks' mode chains as they are")
      .Option("--trajectories", &options->trajectories, "Folder for one <run>.tum per run")
      .Option(
          "--seed", &options->seed, "Seed of the noise estimate's samples and of --selector mcts")
      .Option("--threads",
              &options->threads,
              "Threads of a build, by default as many as the machine runs; the map is the same")
      .InRange(1, 256)
      .Option("--leave-rate-per-s",
              &options->leave_rate_per_s,
              "Rate at which landmarks leave a mode, before there is evidence")
      .InRange(0.0, 1e3)
      .Option("--max-memory-mib",
              &options->max_memory_mib,
              "Leave out the largest logs of a build that would take more; by default, than this "
              "process can have")
      .InRange(1.0, 1e9)
      .Option("RUN.mcap", &options->logs, "Run logs of the area, of any days and vehicles")
      .Required()
      .Check([options] {
        const bool sector = options->field_of_view == FieldOfViewNames().front();
        if (options->engine == "graph" && !sector) {
          return fmt::format("--field-of-view {}: --engine graph knows the sector only",
                             options->field_of_view);
        }
        if (options->engine == "graph" && HasTreeOptions(*options)) {
          return std::string("--tree-…: --engine graph has no tree");
        }
        if (options->engine == "tree" && options->solver != AreaBuildOptions().solver) {
          return fmt::format("--solver {}: --engine tree solves no graph", options->solver);
        }
        if (IsPriorName(options->prior)) return std::string();
        return fmt::format("--prior '{}', expected published, none or a version number",
                           options->prior);
      })
      .Writes();
}

}  // namespace shiftmap
