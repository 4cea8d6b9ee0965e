// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/ijrr_selectors_command.h"

#include <algorithm>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <vector>

#include "tools/experiment/experiment_output.h"
#include "tools/experiment/ijrr_selectors.h"
#include "tools/experiment/mcts_options.h"

namespace shiftmap {
namespace {

// The noise at which figure 5 shows a realization. [m²]
constexpr double kShownNoise = 0.2;

struct Arguments {
  std::string output;
  IjrrSelectorsOptions options;
};

ResultTable MakeTable(const std::vector<IjrrSelectorsRow>& rows) {
  ResultTable table({"noise_m2",
                     "selector",
                     "wrong_ratio",
                     "wrong_ratio_se",
                     "optimal_ratio",
                     "joint_deficit",
                     "select_us",
                     "slam_rmse_m",
                     "slam_wrong_ratio",
                     "slam_wrong_ratio_se",
                     "slam_alternations"});
  for (const IjrrSelectorsRow& row : rows) {
    table.AddRow({row.noise_m2,
                  row.selector,
                  row.wrong_ratio,
                  row.wrong_ratio_se,
                  row.optimal_ratio,
                  row.joint_deficit,
                  row.select_us,
                  row.slam_rmse_m,
                  row.slam_wrong_ratio,
                  row.slam_wrong_ratio_se,
                  row.slam_alternations});
  }
  return table;
}

// A line per selector: one member of the rows over the noise.
Chart OverNoise(const std::vector<IjrrSelectorsRow>& rows,
                double IjrrSelectorsRow::*member,
                const std::string& title,
                const std::string& y_label) {
  Chart chart{.title = title, .x_label = "variance r of an observation [m²]", .y_label = y_label};
  for (const IjrrSelectorsRow& row : rows) {
    SeriesNamed(row.selector, &chart).points.emplace_back(row.noise_m2, row.*member);
  }
  return chart;
}

Chart Realization(const IjrrSelectorsOptions& options) {
  const IjrrRealization realization = SimulateIjrr(options, kShownNoise, 0);
  Chart chart{.title = fmt::format("Observations of one landmark, r = {} m²", kShownNoise),
              .x_label = "x [m]",
              .y_label = "y [m]",
              .equal_axes = true};
  for (std::size_t k = 0; k < options.places.size(); ++k) {
    chart.series.push_back({fmt::format("place {}", k + 1), {}, false});
  }
  for (std::size_t t = 0; t < realization.truth.size(); ++t) {
    chart.series[static_cast<std::size_t>(realization.truth[t])].points.push_back(
        realization.observations[t]);
  }
  chart.series.push_back({"true places", options.places, false, 6.0});
  chart.series.push_back({"robot", {Eigen::Vector2d::Zero()}, false, 6.0});
  return chart;
}

Status WriteFigures(const IjrrSelectorsOptions& options,
                    const std::vector<IjrrSelectorsRow>& rows,
                    ExperimentOutput* output) {
  SHIFTMAP_RETURN_IF_ERROR(output->WriteFigure("places", Realization(options)));
  SHIFTMAP_RETURN_IF_ERROR(output->WriteFigure(
      "wrong",
      OverNoise(rows, &IjrrSelectorsRow::wrong_ratio, "Wrong selections, places known", "share")));
  SHIFTMAP_RETURN_IF_ERROR(output->WriteFigure("slam-rmse",
                                               OverNoise(rows,
                                                         &IjrrSelectorsRow::slam_rmse_m,
                                                         "Last robot and landmark position in SLAM",
                                                         "RMSE [m]")));
  SHIFTMAP_RETURN_IF_ERROR(output->WriteFigure(
      "slam-wrong",
      OverNoise(rows, &IjrrSelectorsRow::slam_wrong_ratio, "Wrong selections in SLAM", "share")));
  Chart time =
      OverNoise(rows, &IjrrSelectorsRow::select_us, "Processor time of one selection", "time [µs]");
  time.log_y = true;
  return output->WriteFigure("time", time);
}

Json OptionsJson(const IjrrSelectorsOptions& options) {
  Json places = Json::array();
  for (const Eigen::Vector2d& place : options.places) places.push_back({place.x(), place.y()});
  return {{"runs", options.runs},
          {"seed", options.seed},
          {"known_start", options.known_start},
          {"places_m", places},
          {"observations_per_place", options.observations_per_place},
          {"change_probability", options.change_probability},
          {"prior_sd_m", options.prior_sd_m},
          {"process_sd", {options.process_sd.x(), options.process_sd.y(), options.process_sd.z()}},
          {"mcts", MctsJson(options.mcts)}};
}

Status Run(const Arguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      ExperimentOutput output,
      ExperimentOutput::Create("ijrr-selectors", arguments.output, context.dry_run()));
  const std::unique_ptr<Progress> progress = context.MakeProgress();
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<IjrrSelectorsRow> rows,
                            RunIjrrSelectors(arguments.options, [&](double done) {
                              progress->Update("realizations", done);
                            }));
  const ResultTable table = MakeTable(rows);
  SHIFTMAP_RETURN_IF_ERROR(WriteFigures(arguments.options, rows, &output));
  return output.Report(OptionsJson(arguments.options), table, &context);
}

}  // namespace

void AddIjrrSelectorsExperiment(Application* application) {
  auto arguments = std::make_shared<Arguments>();
  arguments->options.threads = static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
  Command& command =
      application->AddCommand("ijrr-selectors",
                              "Every selector on the simulation of IJRR 8.1, figures 5 to 7",
                              [arguments](Context& context) { return Run(*arguments, context); });
  command.Option("--output", &arguments->output, "Folder for CSV, JSON and SVG")
      .Required()
      .Option("--runs", &arguments->options.runs, "Monte Carlo realizations per noise")
      .InRange(1, 1e6)
      .Option("--seed", &arguments->options.seed, "Seed of everything random")
      .Option("--threads", &arguments->options.threads, "Realizations side by side")
      .InRange(1, 1024)
      .Option("--prior-sd-m",
              &arguments->options.prior_sd_m,
              "Error of the modes in the map that SLAM starts from")
      .InRange(1e-6, 1e3)
      .Option("--change-probability",
              &arguments->options.change_probability,
              "Of leaving a mode from one observation to the next")
      .InRange(1e-12, 1.0 - 1e-12)
      .Flag("--known-start",
            &arguments->options.known_start,
            "The first place is known to hold at the start")
      .Writes();
  AddMctsOptions(&arguments->options.mcts, &command);
}

}  // namespace shiftmap
