// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/lidar_repeatability_command.h"

#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tools/convert/lidar_json.h"
#include "tools/experiment/experiment_output.h"
#include "tools/experiment/lidar_repeatability.h"

namespace shiftmap {
namespace {

struct Arguments {
  std::string data;
  std::string output;
  RepeatabilityOptions options;
};

Status Measure(const Arguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      ExperimentOutput output,
      ExperimentOutput::Create("lidar-repeatability", arguments.output, context.dry_run()));
  SHIFTMAP_ASSIGN_OR_RETURN(const LidarLog log, ReadLidarJson(arguments.data));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<Repeatability> results,
                            MeasureRepeatability(log, arguments.options));
  ResultTable table(
      {"points", "from_m", "to_m", "scan_pairs", "in_view", "found", "share", "rms_distance_m"});
  Chart chart{.title = "Points of a lidar scan found again in another one",
              .x_label = "distance between the vehicles [m]",
              .y_label = "share found again"};
  for (const Repeatability& result : results) {
    table.AddRow({result.points,
                  result.min_distance_m,
                  result.max_distance_m,
                  static_cast<double>(result.pairs),
                  static_cast<double>(result.in_view),
                  static_cast<double>(result.found),
                  result.Share(),
                  result.RmsDistance()});
    SeriesNamed(result.points, &chart)
        .points.emplace_back(0.5 * (result.min_distance_m + result.max_distance_m), result.Share());
  }
  SHIFTMAP_RETURN_IF_ERROR(output.WriteFigure("share", chart));
  const RepeatabilityOptions& options = arguments.options;
  const Json settings{{"scans", log.scans.size()},
                      {"min_response", options.front_end.points.min_response},
                      {"edges", options.front_end.points.edges},
                      {"max_point_range_m", options.front_end.max_point_range_m},
                      {"found_within_m", options.found_within_m},
                      {"min_overlap", options.min_overlap},
                      {"seed", options.seed}};
  return output.Report(settings, table, &context);
}

}  // namespace

void AddLidarRepeatabilityExperiment(Application* application) {
  auto arguments = std::make_shared<Arguments>();
  RepeatabilityOptions& options = arguments->options;
  application
      ->AddCommand("lidar-repeatability",
                   "Points of lidar scans that are found again from elsewhere",
                   [arguments](Context& context) { return Measure(*arguments, context); })
      .Option("--data", &arguments->data, "JSON log of scans with corrected poses")
      .Required()
      .Option("--output", &arguments->output, "Folder for CSV, JSON and SVG")
      .Required()
      .Option("--min-response", &options.front_end.points.min_response, "Smallest F of a point")
      .InRange(1e-3, 0.3678)
      .Option("--max-point-range-m",
              &options.front_end.max_point_range_m,
              "Points further away do not count")
      .InRange(0.1, 1e4)
      .Option("--found-within-m", &options.found_within_m, "Distance at which points are the same")
      .InRange(1e-3, 10.0)
      .Option("--seed", &options.seed, "Of the random points")
      .Writes();
}

}  // namespace shiftmap
