// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/scale_command.h"

#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tools/experiment/experiment_output.h"
#include "tools/experiment/scale.h"

namespace shiftmap {
namespace {

struct Arguments {
  std::string output;
  int min_key_frames = 1000;
  int max_key_frames = 10000;
  ScaleOptions options;
};

// Of 1000, 3000, 10000, … those from the smallest to the largest.
std::vector<int> Sizes(int smallest, int largest) {
  std::vector<int> sizes;
  for (int decade = 1000; decade <= largest; decade *= 10) {
    for (const int size : {decade, 3 * decade}) {
      if (smallest <= size && size <= largest) sizes.push_back(size);
    }
  }
  return sizes;
}

ResultTable MakeTable(const std::vector<ScaleRow>& rows) {
  ResultTable table({"key_frames",
                     "runs",
                     "rejected",
                     "groups",
                     "modes",
                     "true_modes",
                     "seen_modes",
                     "rms_m",
                     "median_m",
                     "far_modes",
                     "nees",
                     "scale_error",
                     "nees_shape",
                     "build_s",
                     "wall_s",
                     "us_per_frame",
                     "logs_mib",
                     "peak_mib"});
  for (const ScaleRow& row : rows) {
    table.AddRow({static_cast<double>(row.key_frames),
                  static_cast<double>(row.runs),
                  static_cast<double>(row.rejected),
                  static_cast<double>(row.groups),
                  static_cast<double>(row.modes),
                  static_cast<double>(row.true_modes),
                  static_cast<double>(row.seen_modes),
                  row.rms_m,
                  row.median_m,
                  static_cast<double>(row.far_modes),
                  row.nees,
                  row.scale_error,
                  row.nees_shape,
                  row.build_s,
                  row.wall_s,
                  row.us_per_frame,
                  row.logs_mib,
                  row.peak_mib});
  }
  return table;
}

Status Run(const Arguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(ExperimentOutput output,
                            ExperimentOutput::Create("scale", arguments.output, context.dry_run()));
  ScaleOptions options = arguments.options;
  options.key_frames = Sizes(arguments.min_key_frames, arguments.max_key_frames);
  const std::unique_ptr<Progress> progress = context.MakeProgress();
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<ScaleRow> rows, RunScale(options, [&](double done) {
                              progress->Update("sites", done);
                            }));
  const ResultTable table = MakeTable(rows);
  Chart chart{.title = "Processor time of a build per key frame",
              .x_label = "key frames",
              .y_label = "time per key frame [µs]",
              .series = {{"", {}, true}},
              .log_y = true};
  for (const ScaleRow& row : rows) {
    chart.series.front().points.emplace_back(row.key_frames, row.us_per_frame);
  }
  SHIFTMAP_RETURN_IF_ERROR(output.WriteFigure("time", chart));
  return output.Report({{"seed", options.seed},
                        {"scans_per_run", options.scans_per_run},
                        {"scans_per_group", options.scans_per_group},
                        {"max_groups", options.max_groups},
                        {"misread_per_scan", options.misread_per_scan},
                        {"odometry_noise", options.odometry_noise},
                        {"threads", options.threads}},
                       table,
                       &context);
}

}  // namespace

void AddScaleExperiment(Application* application) {
  auto arguments = std::make_shared<Arguments>();
  application
      ->AddCommand("scale",
                   "Time and memory of builds over the size of simulated sites",
                   [arguments](Context& context) { return Run(*arguments, context); })
      .Option("--output", &arguments->output, "Folder for CSV, JSON and SVG")
      .Required()
      .Option("--min-key-frames", &arguments->min_key_frames, "Smallest site")
      .InRange(1000, 1e7)
      .Option("--max-key-frames", &arguments->max_key_frames, "Largest site")
      .InRange(1000, 1e7)
      .Option("--threads", &arguments->options.threads, "Threads of a build")
      .InRange(1, 256)
      .Option("--misread",
              &arguments->options.misread_per_scan,
              "Observations per scan that bear the signature of another landmark")
      .InRange(0, 10)
      .Option("--odometry-noise",
              &arguments->options.odometry_noise,
              "Noise of the odometry, times the usual")
      .InRange(0.01, 100)
      .Option("--seed", &arguments->options.seed, "Seed of the sites")
      .Writes();
}

}  // namespace shiftmap
