// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/victoria_park_command.h"

#include <algorithm>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "tools/experiment/experiment_output.h"
#include "tools/experiment/victoria_park.h"

namespace shiftmap {
namespace {

struct Arguments {
  VictoriaParkOptions data;
  std::string output;
  bool quick = false;
};

// Scans that are taken, one of so many: the fewer, the further the vehicle drives in between.
const std::vector<int> kEvery = {1, 5, 10};

// Everything in the frame of the GPS.
Chart DrawPark(const ParkResult& result, const GpsScore& score, const std::vector<GpsFix>& fixes) {
  Chart chart{
      .title = "Victoria Park: trees, path and GPS",
      .x_label = "x [m]",
      .y_label = "y [m]",
      .series = {{"landmarks", {}, false, 1.8}, {"path", {}, false, 0.9}, {"GPS", {}, false, 0.5}},
      .equal_axes = true};
  // As many as can be told apart.
  for (std::size_t i = 0; i < fixes.size(); i += 3) {
    chart.series[2].points.push_back(fixes[i].p_gps_antenna);
  }
  for (std::size_t i = 0; i < result.trajectory.size(); i += 4) {
    const Se2& pose = result.trajectory[i].T_map_vehicle;
    chart.series[1].points.push_back(score.T_gps_start * (pose * kVictoriaParkLaser));
  }
  for (const Eigen::Vector2d& landmark : result.landmarks) {
    chart.series[0].points.push_back(score.T_gps_start * landmark);
  }
  return chart;
}

Status Measure(const Arguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      ExperimentOutput output,
      ExperimentOutput::Create("victoria-park", arguments.output, context.dry_run()));
  const std::unique_ptr<Progress> progress = context.MakeProgress();
  SHIFTMAP_ASSIGN_OR_RETURN(const VictoriaParkRun park, ReadVictoriaPark(arguments.data));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<GpsFix> fixes,
                            ReadVictoriaParkGps(arguments.data.dataset_dir));
  ResultTable table({"every",
                     "method",
                     "rmse_m",
                     "median_m",
                     "gps_used",
                     "landmarks",
                     "associated",
                     "observations",
                     "cpu_s"});
  MapperOptions options;
  const int min_sightings = options.association.min_sightings;
  const std::vector<int> cases = arguments.quick ? std::vector<int>{1} : kEvery;
  for (std::size_t i = 0; i < cases.size(); ++i) {
    const int every = cases[i];
    progress->Update("every " + std::to_string(every),
                     static_cast<double>(i) / static_cast<double>(cases.size()));
    // Rarer scans see a landmark less often.
    options.association.min_sightings =
        std::max(options.association.confirm_sightings, min_sightings / every);
    const Run run = WithEveryScan(every, park.run);
    std::vector<ParkResult> results = {RunDeadReckoning(run, options.calibration),
                                       RunFilter(run, options, false),
                                       RunFilter(run, options, true)};
    SHIFTMAP_ASSIGN_OR_RETURN(ParkResult mapped, RunMapper(run, options));
    results.push_back(std::move(mapped));
    for (const ParkResult& result : results) {
      SHIFTMAP_ASSIGN_OR_RETURN(const GpsScore score,
                                ScoreAgainstGps(result.trajectory, fixes, kVictoriaParkLaser));
      table.AddRow({static_cast<double>(every),
                    result.method,
                    score.rmse_m,
                    score.median_m,
                    score.used_share,
                    static_cast<double>(result.landmarks.size()),
                    static_cast<double>(result.associated),
                    static_cast<double>(result.observations),
                    result.cpu_s});
      if (i > 0 || &result != &results.back()) continue;
      SHIFTMAP_RETURN_IF_ERROR(output.WriteFigure("map", DrawPark(result, score, fixes)));
    }
  }
  const Json settings{{"every", cases},
                      {"sd_range_m", arguments.data.sd_range_m},
                      {"sd_bearing_rad", arguments.data.sd_bearing_rad}};
  return output.Report(settings, table, &context);
}

}  // namespace

void AddVictoriaParkExperiment(Application* application) {
  auto arguments = std::make_shared<Arguments>();
  application
      ->AddCommand("victoria-park",
                   "4 km between trees without identity, against GPS",
                   [arguments](Context& context) { return Measure(*arguments, context); })
      .Option("--data", &arguments->data.dataset_dir, "Folder with the Victoria Park .csv files")
      .Required()
      .Option("--output", &arguments->output, "Folder for CSV, JSON and SVG")
      .Required()
      .Flag("--quick", &arguments->quick, "Only the case with all scans")
      .Option("--sd-range-m", &arguments->data.sd_range_m, "Noise of ranges")
      .InRange(1e-3, 1e2)
      .Option("--sd-bearing-rad", &arguments->data.sd_bearing_rad, "Noise of bearings")
      .InRange(1e-4, 1.0)
      .Writes();
}

}  // namespace shiftmap
