// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/tiv_mine_command.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>
#include <vector>

#include "mapper/parallel.h"
#include "mapstore/geometry/covariance.h"
#include "tools/experiment/experiment_output.h"
#include "tools/experiment/tiv_arguments.h"
#include "tools/experiment/tiv_mine.h"
#include "tools/experiment/tiv_picture.h"

namespace shiftmap {
namespace {

// What a method's errors come to.
struct Summary {
  double rmse_before_m = 0.0;  // Until a corner is seen that moved.
  double rmse_after_m = 0.0;   // From then on.
  double final_rmse_m = 0.0;
  double mean_nees = 0.0;
  double in_band = 0.0;  // Share of the steps with a mean NEES in its 95 % interval.
};

double RootMeanSquare(const std::vector<TivMineStep>& steps, std::size_t from, std::size_t to) {
  double sum = 0.0;
  for (std::size_t i = from; i < to; ++i) sum += steps[i].rmse_m * steps[i].rmse_m;
  return to > from ? std::sqrt(sum / static_cast<double>(to - from)) : 0.0;
}

Summary Summarize(const std::vector<TivMineStep>& steps, std::size_t change, int runs) {
  const double low = ChiSquareQuantile(0.025, 3 * runs) / runs;
  const double high = ChiSquareQuantile(0.975, 3 * runs) / runs;
  Summary summary;
  summary.rmse_before_m = RootMeanSquare(steps, 0, change);
  summary.rmse_after_m = RootMeanSquare(steps, change, steps.size());
  summary.final_rmse_m = steps.back().rmse_m;
  for (const TivMineStep& step : steps) {
    summary.mean_nees += step.nees / static_cast<double>(steps.size());
    summary.in_band +=
        (step.nees >= low && step.nees <= high ? 1.0 : 0.0) / static_cast<double>(steps.size());
  }
  return summary;
}

struct Method {
  const char* name;
  const std::vector<TivError> TivMineRun::*errors;
};

constexpr Method kMethods[] = {{"multi-hypothesis", &TivMineRun::multi},
                               {"static", &TivMineRun::fixed},
                               {"dead reckoning", &TivMineRun::reckoning}};

StatusOr<std::vector<TivMineRun>> RunAll(const TivWorld& world, const TivArguments& arguments) {
  std::vector<StatusOr<TivMineRun>> results(static_cast<std::size_t>(arguments.runs), TivMineRun());
  ForEachIndex(results.size(), arguments.threads, [&](std::size_t i) {
    const StatusOr<TivWorld> own = arguments.WorldOf(world, i);
    results[i] = own.ok() ? RunTivMine(*own, arguments.SeedOf(i)) : own.status();
  });
  std::vector<TivMineRun> runs;
  for (StatusOr<TivMineRun>& result : results) {
    SHIFTMAP_RETURN_IF_ERROR(result.status());
    runs.push_back(*std::move(result));
  }
  return runs;
}

// The first step at which half of the drives see a corner that moved.
std::size_t ChangeStep(const std::vector<TivMineRun>& runs) {
  std::vector<bool> seen(runs.size());
  const std::size_t steps = runs.front().corner_seen.size();
  for (std::size_t i = 0; i < steps; ++i) {
    for (std::size_t r = 0; r < runs.size(); ++r) seen[r] = seen[r] || runs[r].corner_seen[i];
    if (2 * std::count(seen.begin(), seen.end(), true) >= std::ssize(seen)) return i;
  }
  return steps;
}

// What only TreeSlam has.
struct TreeSummary {
  double leaves = 0.0;  // Mean over drives and steps.
  int leaves_max = 0;
  int corners = 0;  // That moved and were seen, over all drives.
  int kept = 0;     // Of these: the likeliest state is where the prior map has them.
};

TreeSummary SummarizeTree(const std::vector<TivMineRun>& runs) {
  TreeSummary summary;
  for (const TivMineRun& run : runs) {
    for (const int count : run.leaves) {
      summary.leaves +=
          static_cast<double>(count) / static_cast<double>(run.leaves.size() * runs.size());
      summary.leaves_max = std::max(summary.leaves_max, count);
    }
    for (const TivCorner& corner : run.corners) {
      ++summary.corners;
      summary.kept += corner.p_prior > 0.5;
    }
  }
  return summary;
}

using StepsByMethod = std::vector<std::vector<TivMineStep>>;  // In the order of kMethods.

ResultTable SummaryTable(const std::vector<TivMineRun>& runs, const StepsByMethod& steps) {
  ResultTable table({"method",
                     "rmse_before_m",
                     "rmse_after_m",
                     "final_rmse_m",
                     "mean_nees",
                     "steps_in_band",
                     "leaves",
                     "leaves_max",
                     "corners_seen",
                     "prior_kept"});
  const TreeSummary tree = SummarizeTree(runs);
  const std::size_t change = ChangeStep(runs);
  for (std::size_t m = 0; m < std::size(kMethods); ++m) {
    const Summary of = Summarize(steps[m], change, static_cast<int>(runs.size()));
    const auto only = [&](double value) {
      return m == 0 ? value : std::numeric_limits<double>::quiet_NaN();
    };
    table.AddRow({std::string(kMethods[m].name),
                  of.rmse_before_m,
                  of.rmse_after_m,
                  of.final_rmse_m,
                  of.mean_nees,
                  of.in_band,
                  only(tree.leaves),
                  only(tree.leaves_max),
                  only(tree.corners),
                  only(tree.kept)});
  }
  return table;
}

ResultTable StepsTable(const std::vector<TivMineRun>& runs,
                       const StepsByMethod& steps,
                       double scan_rate_hz) {
  ResultTable table({"time_s",
                     "corner_seen",
                     "rmse_multi_m",
                     "rmse_static_m",
                     "rmse_reckoning_m",
                     "nees_multi",
                     "nees_static",
                     "nees_reckoning"});
  for (std::size_t i = 0; i < steps.front().size(); ++i) {
    double seen = 0.0;
    for (const TivMineRun& run : runs) {
      seen += (run.corner_seen[i] ? 1.0 : 0.0) / static_cast<double>(runs.size());
    }
    table.AddRow({static_cast<double>(i) / scan_rate_hz,
                  seen,
                  steps[0][i].rmse_m,
                  steps[1][i].rmse_m,
                  steps[2][i].rmse_m,
                  steps[0][i].nees,
                  steps[1][i].nees,
                  steps[2][i].nees});
  }
  return table;
}

// One line per method over time.
Chart ChartOf(const StepsByMethod& steps,
              double TivMineStep::*value,
              double scan_rate_hz,
              const std::string& title,
              const std::string& y_label) {
  Chart chart{.title = title, .x_label = "time [s]", .y_label = y_label, .log_y = true};
  for (std::size_t m = 0; m < std::size(kMethods); ++m) {
    ChartSeries& series = SeriesNamed(kMethods[m].name, &chart);
    series.marker_radius = 0.0;
    for (std::size_t i = 0; i < steps[m].size(); ++i) {
      series.points.emplace_back(static_cast<double>(i) / scan_rate_hz, steps[m][i].*value);
    }
  }
  return chart;
}

Status MeasureMine(const TivArguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      ExperimentOutput output,
      ExperimentOutput::Create("tiv-mine", arguments.output, context.dry_run()));
  SHIFTMAP_ASSIGN_OR_RETURN(const TivWorld world, TivWorld::Make(arguments.World()));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<TivMineRun> runs, RunAll(world, arguments));
  StepsByMethod steps;
  for (const Method& method : kMethods) steps.push_back(MeanOverRuns(runs, method.errors));
  const double rate_hz = world.options().scan_rate_hz;
  SHIFTMAP_RETURN_IF_ERROR(output.WriteTable(StepsTable(runs, steps, rate_hz)));
  SHIFTMAP_RETURN_IF_ERROR(output.WriteFigure("rmse",
                                              ChartOf(steps,
                                                      &TivMineStep::rmse_m,
                                                      rate_hz,
                                                      "Mine, modified after it was mapped",
                                                      "RMSE of the position [m]")));
  SHIFTMAP_RETURN_IF_ERROR(output.WriteFigure(
      "nees", ChartOf(steps, &TivMineStep::nees, rate_hz, "Consistency: 3 is right", "mean NEES")));
  const ResultTable summary = SummaryTable(runs, steps);
  SHIFTMAP_ASSIGN_OR_RETURN(const Json document,
                            output.WriteDocument(arguments.OptionsJson(), summary));
  context.Report(document, summary.ToText());
  return OkStatus();
}

Status DrawPosterior(const TivArguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      ExperimentOutput output,
      ExperimentOutput::Create("tiv-posterior", arguments.output, context.dry_run()));
  SHIFTMAP_ASSIGN_OR_RETURN(const TivWorld world, TivWorld::Make(arguments.World()));
  SHIFTMAP_ASSIGN_OR_RETURN(const TivMineRun run, RunTivMine(world, arguments.SeedOf(0)));
  ResultTable table({"signature", "mode", "x_m", "y_m", "probability"});
  for (const LandmarkGroup& group : run.posterior.groups) {
    for (std::size_t k = 0; k < group.modes.size(); ++k) {
      const Mode& mode = group.modes[k];
      table.AddRow({group.signature.text(),
                    static_cast<double>(mode.number.value()),
                    mode.p_map_landmark.x(),
                    mode.p_map_landmark.y(),
                    group.probabilities(static_cast<Eigen::Index>(k) + 1)});
    }
  }
  SHIFTMAP_RETURN_IF_ERROR(output.WriteTable(table));
  SHIFTMAP_RETURN_IF_ERROR(output.WritePicture("map", DrawTivPosterior(world, run)));
  SHIFTMAP_ASSIGN_OR_RETURN(const Json document,
                            output.WriteDocument(arguments.OptionsJson(), table));
  context.Report(document, table.ToText());
  return OkStatus();
}

}  // namespace

void AddTivMineExperiments(Application* application) {
  auto arguments = std::make_shared<TivArguments>();
  Command& command = application->AddCommand(
      "tiv-mine",
      "T-IV figure 6: a mine that was modified after it was mapped",
      [arguments](Context& context) { return MeasureMine(*arguments, context); });
  arguments->AddTo(&command);
  auto posterior = std::make_shared<TivArguments>();
  Command& drawn = application->AddCommand(
      "tiv-posterior",
      "T-IV figure 8: map and trajectories after one drive through the modified mine",
      [posterior](Context& context) { return DrawPosterior(*posterior, context); });
  posterior->AddTo(&drawn);
}

}  // namespace shiftmap
