// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/localizer_consistency_command.h"

#include <memory>
#include <nlohmann/json.hpp>
#include <vector>

#include "mapstore/geometry/covariance.h"
#include "tools/experiment/experiment_output.h"
#include "tools/experiment/localizer_consistency.h"

namespace shiftmap {
namespace {

struct Arguments {
  std::string output;
  int runs = 100;
  int threads = 1;
  double correlation = 0.5;
  std::uint64_t seed = 1;
};

Status Measure(const Arguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      ExperimentOutput output,
      ExperimentOutput::Create("localizer-consistency", arguments.output, context.dry_run()));
  const double low = ChiSquareQuantile(0.025, 3 * arguments.runs) / arguments.runs;
  const double high = ChiSquareQuantile(0.975, 3 * arguments.runs) / arguments.runs;
  ResultTable table(
      {"sd_map_m", "nees", "low", "high", "nees_exact_map", "rmse_m", "rmse_exact_map_m"});
  ChartSeries considered{"map considered"};
  ChartSeries exact{"map taken as exact"};
  const std::unique_ptr<Progress> progress = context.MakeProgress();
  const std::vector<double> sds = {0.0, 0.1, 0.25, 0.5};
  for (const double sd_map : sds) {
    ConsistencyScene scene;
    scene.sd_map_m = sd_map;
    scene.correlation = arguments.correlation;
    const ConsistencyResult result =
        MeasureConsistency(scene, arguments.seed, arguments.runs, arguments.threads);
    table.AddRow(
        {sd_map, result.nees, low, high, result.nees_exact, result.rmse_m, result.rmse_exact_m});
    considered.points.emplace_back(sd_map, result.nees);
    exact.points.emplace_back(sd_map, result.nees_exact);
    progress->Update("runs",
                     static_cast<double>(table.rows().size()) / static_cast<double>(sds.size()));
  }
  SHIFTMAP_RETURN_IF_ERROR(output.WritePage("Consistency of the pose on an uncertain map", table));
  const Chart chart{.title = "Consistency of the pose on an uncertain map",
                    .x_label = "standard deviation of the map [m]",
                    .y_label = "mean NEES, 3 if consistent",
                    .series = {considered, exact},
                    .log_y = true};
  SHIFTMAP_RETURN_IF_ERROR(output.WriteFigure("nees", chart));
  const Json options{
      {"runs", arguments.runs}, {"seed", arguments.seed}, {"correlation", arguments.correlation}};
  return output.Report(options, table, &context);
}

}  // namespace

void AddLocalizerConsistencyExperiment(Application* application) {
  auto arguments = std::make_shared<Arguments>();
  application
      ->AddCommand("localizer-consistency",
                   "Error of the pose against its covariance on uncertain maps",
                   [arguments](Context& context) { return Measure(*arguments, context); })
      .Option("--output", &arguments->output, "Folder for CSV, JSON, SVG and a page")
      .Required()
      .Option("--runs", &arguments->runs, "Simulated drives per row")
      .InRange(2, 1000000)
      .Option("--correlation", &arguments->correlation, "Between the errors of two landmarks")
      .InRange(0.0, 0.99)
      .Option("--threads", &arguments->threads, "Threads; the results do not depend on it")
      .InRange(1, 64)
      .Option("--seed", &arguments->seed, "Seed of the first drive")
      .Writes();
}

}  // namespace shiftmap
