// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/localizer_utias_command.h"

#include <array>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "tools/convert/utias.h"
#include "tools/experiment/experiment_output.h"
#include "tools/experiment/localizer_utias.h"

namespace shiftmap {
namespace {

constexpr std::array<int, 4> kDatasets = {1, 2, 3, 6};

struct Arguments {
  std::string data;
  std::string output;
  int robot = 2;
  int starts = 3;
  std::uint64_t seed = 1;
  LayoutOptions options;
};

Status Measure(const Arguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      ExperimentOutput output,
      ExperimentOutput::Create("localizer-utias", arguments.output, context.dry_run()));
  const std::unique_ptr<Progress> progress = context.MakeProgress();
  progress->Update("calibration", 0.0);
  SHIFTMAP_ASSIGN_OR_RETURN(const Calibration calibration, MappedCalibration(arguments.data));
  std::vector<Layout> layouts;
  for (const int dataset : kDatasets) {
    SHIFTMAP_ASSIGN_OR_RETURN(
        Layout layout,
        ReadUtiasLandmarks(arguments.data + "/MRCLAM_Dataset" + std::to_string(dataset)));
    layouts.push_back(std::move(layout));
  }
  ResultTable table({"dataset",
                     "believed",
                     "start",
                     "rmse_m",
                     "rmse_oracle_m",
                     "rmse_stale_m",
                     "decisions",
                     "wrong",
                     "median_observations"});
  Chart chart{.title = "Localization with the wrong layout believed",
              .x_label = "data set",
              .y_label = "position RMSE [m]",
              .series = {{"all layouts", {}, false},
                         {"told the layout", {}, false},
                         {"stale layout", {}, false}},
              .log_y = true};
  for (int layout = 0; layout < static_cast<int>(kDatasets.size()); ++layout) {
    const int dataset = kDatasets[static_cast<std::size_t>(layout)];
    const int stale = (layout + 1) % static_cast<int>(kDatasets.size());
    SHIFTMAP_ASSIGN_OR_RETURN(const TrueShift shift,
                              LoadUtiasShift(arguments.data, dataset, arguments.robot, layout));
    for (int start = 0; start < arguments.starts; ++start) {
      const std::uint64_t seed = arguments.seed + static_cast<std::uint64_t>(start);
      const UtiasShiftResult result =
          LocalizeUtias(shift, layouts, stale, calibration, arguments.options, seed);
      table.AddRow({static_cast<double>(dataset),
                    static_cast<double>(kDatasets[static_cast<std::size_t>(stale)]),
                    static_cast<double>(seed),
                    result.rmse_m,
                    result.rmse_oracle_m,
                    result.rmse_stale_m,
                    static_cast<double>(result.decisions),
                    static_cast<double>(result.wrong),
                    result.median_observations});
      chart.series[0].points.emplace_back(dataset, result.rmse_m);
      chart.series[1].points.emplace_back(dataset, result.rmse_oracle_m);
      chart.series[2].points.emplace_back(dataset, result.rmse_stale_m);
    }
    progress->Update("runs", (layout + 1.0) / static_cast<double>(kDatasets.size()));
  }
  SHIFTMAP_RETURN_IF_ERROR(
      output.WritePage("Recorded robots with the wrong layout believed", table));
  SHIFTMAP_RETURN_IF_ERROR(output.WriteFigure("rmse", chart));
  const LayoutOptions& shift = arguments.options;
  const Json options{{"robot", arguments.robot},
                     {"seed", arguments.seed},
                     {"alpha", shift.alpha},
                     {"stale_probability", shift.stale_probability},
                     {"sd_start_m", shift.sd_start_m},
                     {"sd_start_rad", shift.sd_start_rad},
                     {"sd_survey_m", shift.sd_survey_m},
                     {"settled_after_s", shift.settled_after_s}};
  return output.Report(options, table, &context);
}

}  // namespace

void AddLocalizerUtiasExperiment(Application* application) {
  auto arguments = std::make_shared<Arguments>();
  application
      ->AddCommand("localizer-utias",
                   "Recorded robots with four layouts known and the wrong one believed",
                   [arguments](Context& context) { return Measure(*arguments, context); })
      .Option("--data", &arguments->data, "Folder with MRCLAM_Dataset1, 2, 3 and 6")
      .Required()
      .Option("--output", &arguments->output, "Folder for CSV, JSON, SVG and a page")
      .Required()
      .Option("--robot", &arguments->robot, "Robot that is localized")
      .InRange(1, 5)
      .Option("--starts", &arguments->starts, "Draws of the start per data set")
      .InRange(1, 1000)
      .Option("--seed", &arguments->seed, "Seed of the first start")
      .Writes();
}

}  // namespace shiftmap
