// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/engines_command.h"

#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tools/experiment/engines.h"
#include "tools/experiment/experiment_output.h"

namespace shiftmap {
namespace {

struct Arguments {
  std::string output;
  std::vector<std::string> kinds;
  EnginesOptions options;
};

double Share(int part, int whole) { return static_cast<double>(part) / whole; }

double Rms(double squares, int count) { return std::sqrt(squares / count); }

void AddCells(const EngineScore& score, int groups, std::vector<ResultTable::Cell>* cells) {
  for (const double value : {static_cast<double>(score.modes),
                             Share(score.groups_right, groups),
                             static_cast<double>(score.missing),
                             static_cast<double>(score.spurious),
                             Rms(score.squared_m2, score.matched),
                             Rms(score.squared_of_poses_m2, score.poses),
                             score.squared_deviations / score.matched,
                             score.processor_s,
                             score.wall_s,
                             static_cast<double>(score.left_out)}) {
    cells->emplace_back(value);
  }
}

// @param seed  Empty for several sites.
void AddRow(const EnginesRow& row, ResultTable::Cell seed, ResultTable* table) {
  const EngineDifference& difference = row.difference;
  std::vector<ResultTable::Cell> cells = {row.kind, std::move(seed)};
  for (const double value : {static_cast<double>(row.runs),
                             static_cast<double>(difference.groups),
                             Share(difference.same_number, difference.groups),
                             Rms(difference.squared_m2, difference.matched),
                             Share(difference.axes_within_sd, 2 * difference.matched),
                             Share(difference.within_ellipse39, difference.matched),
                             Share(difference.within_ellipse95, difference.matched)}) {
    cells.emplace_back(value);
  }
  AddCells(row.graph, difference.groups, &cells);
  AddCells(row.tree, difference.groups, &cells);
  table->AddRow(std::move(cells));
}

// A row per site, one per kind that has several, and one of all.
ResultTable MakeTable(const EnginesResult& result) {
  std::vector<std::string> columns = {"kind",
                                      "seed",
                                      "runs",
                                      "groups",
                                      "same_number",
                                      "apart_rms_m",
                                      "axes_within_sd",
                                      "within_ellipse39",
                                      "within_ellipse95"};
  for (const std::string engine : {"graph", "tree"}) {
    for (const char* column : {"modes",
                               "groups_right",
                               "missing",
                               "spurious",
                               "rmse_m",
                               "trajectory_rmse_m",
                               "nees",
                               "processor_s",
                               "wall_s",
                               "left_out"}) {
      columns.push_back(engine + "_" + column);
    }
  }
  ResultTable table(columns);
  EnginesRow all;
  all.kind = "all";
  std::vector<EnginesRow> kinds;
  for (const EnginesRow& row : result.sites) {
    AddRow(row, static_cast<double>(row.seed), &table);
    if (kinds.empty() || kinds.back().kind != row.kind) {
      kinds.emplace_back().kind = row.kind;
    }
    kinds.back().Add(row);
    all.Add(row);
  }
  for (const EnginesRow& kind : kinds) AddRow(kind, "all", &table);
  AddRow(all, "all", &table);
  return table;
}

ResultTable MakeExceptions(const EnginesResult& result) {
  ResultTable table({"kind",
                     "seed",
                     "landmark",
                     "graph_modes",
                     "tree_modes",
                     "true_modes",
                     "seen_places",
                     "apart_m",
                     "deviations"});
  for (const EnginesException& exception : result.exceptions) {
    table.AddRow({exception.kind,
                  static_cast<double>(exception.seed),
                  exception.signature.text(),
                  static_cast<double>(exception.graph_modes),
                  static_cast<double>(exception.tree_modes),
                  static_cast<double>(exception.true_modes),
                  static_cast<double>(exception.seen_places),
                  exception.apart_m,
                  exception.deviations});
  }
  return table;
}

// A point per site on either engine's axis.
Chart ErrorChart(const EnginesResult& result) {
  Chart chart{.title = "Error of modes after rigid alignment",
              .x_label = "graph engine: RMSE [m]",
              .y_label = "tree engine: RMSE [m]",
              .equal_axes = true};
  for (const EnginesRow& row : result.sites) {
    ChartSeries& series = SeriesNamed(row.kind, &chart);
    series.line = false;
    series.points.emplace_back(Rms(row.graph.squared_m2, row.graph.matched),
                               Rms(row.tree.squared_m2, row.tree.matched));
  }
  return chart;
}

Status RunExperiment(const Arguments& arguments, Context& context) {
  EnginesOptions options = arguments.options;
  if (!arguments.kinds.empty()) options.kinds = arguments.kinds;
  if (context.dry_run()) options.kinds.clear();
  SHIFTMAP_ASSIGN_OR_RETURN(
      ExperimentOutput output,
      ExperimentOutput::Create("engines", arguments.output, context.dry_run()));
  SHIFTMAP_ASSIGN_OR_RETURN(
      ExperimentOutput exceptions_output,
      ExperimentOutput::Create("engines-exceptions", arguments.output, context.dry_run()));
  const std::unique_ptr<Progress> progress = context.MakeProgress();
  SHIFTMAP_ASSIGN_OR_RETURN(const EnginesResult result, RunEngines(options, [&](double done) {
                              progress->Update("sites", done);
                            }));
  const ResultTable table = MakeTable(result);
  const ResultTable exceptions = MakeExceptions(result);
  const Json settings = {
      {"seed", options.seed}, {"sites", options.sites}, {"kinds", options.kinds}};
  SHIFTMAP_RETURN_IF_ERROR(output.WriteFigure("errors", ErrorChart(result)));
  return output.ReportBoth(settings, table, exceptions, &exceptions_output, &context);
}

}  // namespace

void AddEnginesExperiment(Application* application) {
  auto arguments = std::make_shared<Arguments>();
  application
      ->AddCommand("engines",
                   "Maps of the graph and of the tree engine on the same simulated sites",
                   [arguments](Context& context) { return RunExperiment(*arguments, context); })
      .Option("--output", &arguments->output, "Folder for CSV, JSON and SVG")
      .Required()
      .Option("--kinds", &arguments->kinds, "Only these kinds of sites")
      .OneOf(EngineSiteKinds())
      .Option("--sites", &arguments->options.sites, "Sites of each kind")
      .InRange(1, 10000)
      .Option("--seed", &arguments->options.seed, "Seed of the first site of each kind")
      .Writes();
}

}  // namespace shiftmap
