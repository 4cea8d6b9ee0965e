// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/tiv_approximations_command.h"

#include <algorithm>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <vector>

#include "tools/experiment/experiment_output.h"
#include "tools/experiment/tiv_approximations.h"
#include "tools/experiment/tiv_approximations_figure.h"

namespace shiftmap {
namespace {

// The arms that figures over time show; all are in the table.
constexpr const char* kShownArms[] = {
    "gated only", "ungated too", "transform", "child", "mixture", "no merging"};

struct Arguments {
  std::string output;
  TivApproximationsOptions options;
};

const char* Presence(bool false_alarms) { return false_alarms ? "present" : "absent"; }

ResultTable MakeTable(const std::vector<TivApproximationsRow>& rows) {
  ResultTable table({"false_alarms",
                     "arm",
                     "rmse_m",
                     "rmse_se_m",
                     "rmse_paired_m",
                     "rmse_paired_se_m",
                     "nees",
                     "nees_se",
                     "leaves",
                     "leaves_max",
                     "scans_to_right",
                     "scans_to_right_se",
                     "undecided_share",
                     "wrong_decisions",
                     "wrong_decisions_se",
                     "moved_right",
                     "moved_right_se",
                     "drives_right",
                     "drives_right_se",
                     "spurious_modes",
                     "spurious_modes_se"});
  for (const TivApproximationsRow& row : rows) {
    table.AddRow({Presence(row.false_alarms),
                  row.arm.name,
                  row.rmse_m.mean,
                  row.rmse_m.standard_error,
                  row.rmse_paired_m.mean,
                  row.rmse_paired_m.standard_error,
                  row.nees.mean,
                  row.nees.standard_error,
                  row.leaves,
                  static_cast<double>(row.leaves_max),
                  row.scans_to_right.mean,
                  row.scans_to_right.standard_error,
                  row.undecided_share,
                  row.wrong_decisions.mean,
                  row.wrong_decisions.standard_error,
                  row.moved_right.mean,
                  row.moved_right.standard_error,
                  row.drives_right.mean,
                  row.drives_right.standard_error,
                  row.spurious_modes.mean,
                  row.spurious_modes.standard_error});
  }
  return table;
}

ResultTable MakeTimeTable(const std::vector<TivApproximationsRow>& rows) {
  ResultTable table({"false_alarms", "arm", "t_s", "rmse_m", "rmse_se_m", "nees", "nees_se"});
  for (const TivApproximationsRow& row : rows) {
    for (std::size_t t = 0; t < row.nees_over_time.size(); ++t) {
      table.AddRow({Presence(row.false_alarms),
                    row.arm.name,
                    kTivScanPeriod * static_cast<double>(t + 1),
                    row.rmse_over_time_m[t].mean,
                    row.rmse_over_time_m[t].standard_error,
                    row.nees_over_time[t].mean,
                    row.nees_over_time[t].standard_error});
    }
  }
  return table;
}

// What the panels show, in numbers.
ResultTable MakePanelTable(const TivFigureMoments& moments,
                           const std::vector<HypothesisPair>& ungated,
                           const std::vector<HypothesisPair>& gated) {
  ResultTable table({"panel", "scan", "a", "b"});
  const auto add = [&](const char* panel, const std::vector<HypothesisPair>& pairs, int scan) {
    const HypothesisPair& pair = pairs[static_cast<std::size_t>(scan)];
    table.AddRow({panel, scan + 1.0, pair.ProbabilityOfA(), pair.ProbabilityOfB()});
  };
  add("b", ungated, moments.adapted);
  add("c", ungated, moments.selected);
  add("d", gated, moments.rejected);
  return table;
}

// A line per arm that is shown, over time.
Chart OverTime(const std::vector<TivApproximationsRow>& rows,
               bool false_alarms,
               std::vector<SampleMean> TivApproximationsRow::*member,
               const std::string& title,
               const std::string& y_label) {
  Chart chart{.title = fmt::format("{}, false alarms {}", title, Presence(false_alarms)),
              .x_label = "time [s]",
              .y_label = y_label};
  for (const TivApproximationsRow& row : rows) {
    const auto* const shown = std::find(std::begin(kShownArms), std::end(kShownArms), row.arm.name);
    if (row.false_alarms != false_alarms || shown == std::end(kShownArms)) continue;
    ChartSeries& series = SeriesNamed(row.arm.name, &chart);
    series.marker_radius = 0.0;
    for (std::size_t t = 0; t < (row.*member).size(); ++t) {
      series.points.emplace_back(kTivScanPeriod * static_cast<double>(t + 1),
                                 (row.*member)[t].mean);
    }
  }
  return chart;
}

Status WriteTimeFigures(const std::vector<TivApproximationsRow>& rows, ExperimentOutput* output) {
  for (const bool false_alarms : {false, true}) {
    const std::string suffix = false_alarms ? "-alarms" : "";
    SHIFTMAP_RETURN_IF_ERROR(output->WriteFigure("rmse" + suffix,
                                                 OverTime(rows,
                                                          false_alarms,
                                                          &TivApproximationsRow::rmse_over_time_m,
                                                          "Position of the vehicle",
                                                          "RMSE [m]")));
    SHIFTMAP_RETURN_IF_ERROR(output->WriteFigure("nees" + suffix,
                                                 OverTime(rows,
                                                          false_alarms,
                                                          &TivApproximationsRow::nees_over_time,
                                                          "Pose of the vehicle, 3 if consistent",
                                                          "NEES")));
  }
  return OkStatus();
}

Json OptionsJson(const TivApproximationsOptions& options, const ResultTable& panels) {
  const ApproximationsDriveOptions& drive = options.drive;
  return {{"drives", options.drives},
          {"seed", options.seed},
          {"scans", drive.scans},
          {"sd_start_m", drive.sd_start_m},
          {"sd_start_yaw_rad", drive.sd_start_yaw_rad},
          {"sd_mode_m", drive.sd_mode_m},
          {"sd_position_m", drive.sd_position_m},
          {"detection_probability", drive.detection_probability},
          {"false_alarms_per_m2", drive.false_alarms_per_m2},
          {"figure_3", RowsJson(panels)}};
}

Status RunTivApproximationsExperiment(const Arguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      ExperimentOutput output,
      ExperimentOutput::Create("tiv-approximations", arguments.output, context.dry_run()));
  SHIFTMAP_ASSIGN_OR_RETURN(
      ExperimentOutput over_time,
      ExperimentOutput::Create("tiv-approximations-time", arguments.output, context.dry_run()));
  const std::unique_ptr<Progress> progress = context.MakeProgress();
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<TivApproximationsRow> rows,
                            RunTivApproximations(arguments.options, [&](double done) {
                              progress->Update("drives", done);
                            }));
  const TivFigureScene scene = MakeTivFigureScene();
  const std::vector<HypothesisPair> ungated = FollowTivFigure(scene, true);
  const std::vector<HypothesisPair> gated = FollowTivFigure(scene, false);
  const ResultTable panels =
      MakePanelTable(FindTivFigureMoments(scene, ungated, gated), ungated, gated);
  const ResultTable table = MakeTable(rows);
  SHIFTMAP_RETURN_IF_ERROR(over_time.WriteTable(MakeTimeTable(rows)));
  SHIFTMAP_RETURN_IF_ERROR(output.WritePicture("figure-3", DrawTivFigure(scene, ungated, gated)));
  SHIFTMAP_RETURN_IF_ERROR(WriteTimeFigures(rows, &output));
  return output.Report(OptionsJson(arguments.options, panels), table, &context);
}

}  // namespace

void AddTivApproximationsExperiment(Application* application) {
  auto arguments = std::make_shared<Arguments>();
  TivApproximationsOptions& options = arguments->options;
  options.threads = static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
  application
      ->AddCommand("tiv-approximations",
                   "T-IV figure 3, and the approximations of T-IV VI-B and VII on simulated drives",
                   [arguments](Context& context) {
                     return RunTivApproximationsExperiment(*arguments, context);
                   })
      .Option("--output", &arguments->output, "Folder for CSV, JSON and SVG")
      .Required()
      .Option("--drives", &options.drives, "Simulated drives, the same for every setting")
      .InRange(1, 1e6)
      .Option("--scans", &options.drive.scans, "Scans of a drive")
      .InRange(20, 1e5)
      .Option("--sd-start-m", &options.drive.sd_start_m, "Uncertainty of the start [m]")
      .InRange(1e-3, 10.0)
      .Option("--seed", &options.seed, "Seed of the first drive")
      .Option("--threads", &options.threads, "Drives side by side")
      .InRange(1, 1024)
      .Writes();
}

}  // namespace shiftmap
