// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/localizer_decisions_command.h"

#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <vector>

#include "tools/experiment/experiment_output.h"
#include "tools/experiment/localizer_decisions.h"

namespace shiftmap {
namespace {

struct Arguments {
  std::string output;
  int visits = 2000;
  int threads = 1;
  int groups = 3;
  double sd_mode_m = 0.05;
  double outlier_share = 0.0;
  bool blind = false;
  double slip_share = 0.0;
  int alone_scans = 10;
  std::uint64_t seed = 1;
  int max_leaves = HypothesisOptions().max_leaves;

  // The only one of its kind; nothing: all of them.
  std::optional<double> alpha;
  std::optional<double> sd_pose_m;
  std::optional<std::int64_t> modes;
  std::optional<double> clutter_per_m2;
};

template <typename T>
std::vector<T> Chosen(const std::optional<T>& only, std::vector<T> all) {
  return only ? std::vector<T>{*only} : all;
}

struct Row {
  VisitScene scene;
  double alpha = 0.0;
  DecisionTally tally;
};

// What all scenes have in common.
VisitScene SceneOf(const Arguments& arguments, std::int64_t modes, double clutter_per_m2) {
  VisitScene scene;
  scene.sd_mode_m = arguments.sd_mode_m;
  scene.groups = arguments.groups;
  scene.modes = static_cast<int>(modes);
  scene.clutter_density_per_m2 = clutter_per_m2;
  scene.outlier_share = arguments.outlier_share;
  return scene;
}

// Visits that begin after a stretch without sightings, with one landmark in view.
std::vector<VisitScene> BlindScenes(const Arguments& arguments) {
  std::vector<VisitScene> scenes;
  for (const double blind_s : {5.0, 15.0, 30.0, 60.0}) {
    for (const std::int64_t modes : Chosen(arguments.modes, {2, 3, 4})) {
      VisitScene scene = SceneOf(arguments, modes, arguments.clutter_per_m2.value_or(1e-4));
      scene.blind_s = blind_s;
      scene.slip_share = arguments.slip_share;
      scene.alone_scans = arguments.alone_scans;
      scene.sd_pose_m = arguments.sd_pose_m.value_or(scene.sd_pose_m);
      scenes.push_back(scene);
    }
  }
  return scenes;
}

std::vector<VisitScene> Scenes(const Arguments& arguments) {
  std::vector<VisitScene> scenes;
  if (arguments.blind) return BlindScenes(arguments);
  for (const double sd_pose : Chosen(arguments.sd_pose_m, {0.02, 0.1, 0.3, 1.0})) {
    for (const std::int64_t modes : Chosen(arguments.modes, {2, 3, 4})) {
      for (const double clutter : Chosen(arguments.clutter_per_m2, {1e-4, 1e-3})) {
        VisitScene scene = SceneOf(arguments, modes, clutter);
        scene.sd_pose_m = sd_pose;
        scene.sd_yaw_rad = 0.02 + 0.08 * sd_pose;
        scenes.push_back(scene);
      }
    }
  }
  return scenes;
}

ResultTable MakeTable(const std::vector<Row>& rows) {
  ResultTable table({"alpha",
                     "blind_s",
                     "sd_pose_m",
                     "modes",
                     "clutter_per_m2",
                     "decisions",
                     "wrong",
                     "wrong_share",
                     "low",
                     "high",
                     "undecided_share",
                     "mean_delay",
                     "wald_bound"});
  for (const Row& row : rows) {
    const Interval wrong = IntervalOf(row.tally.Wrong());
    table.AddRow({row.alpha,
                  row.scene.blind_s,
                  row.scene.sd_pose_m,
                  static_cast<double>(row.scene.modes),
                  row.scene.clutter_density_per_m2,
                  static_cast<double>(row.tally.decided),
                  static_cast<double>(row.tally.wrong),
                  row.tally.WrongShare(),
                  wrong.low,
                  wrong.high,
                  row.tally.UndecidedShare(),
                  row.tally.MeanDelay(),
                  row.tally.WaldDelay()});
  }
  return table;
}

// Wrong share over pose uncertainty, a line per α and number of modes, for the least clutter.
Chart WrongShareChart(const std::vector<Row>& rows) {
  Chart chart{.title = "Wrong decisions",
              .x_label = "standard deviation of the pose at the start [log10 m]",
              .y_label = "share of decisions that are wrong",
              .log_y = true};
  for (const Row& row : rows) {
    if (row.scene.clutter_density_per_m2 > rows.front().scene.clutter_density_per_m2) continue;
    const std::string name = fmt::format("α {}, {} modes", row.alpha, row.scene.modes);
    auto series = chart.series.begin();
    while (series != chart.series.end() && series->name != name) ++series;
    if (series == chart.series.end()) series = chart.series.insert(series, {name});
    series->points.emplace_back(std::log10(row.scene.sd_pose_m), row.tally.WrongShare());
  }
  return chart;
}

Status Measure(const Arguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      ExperimentOutput output,
      ExperimentOutput::Create("localizer-decisions", arguments.output, context.dry_run()));
  const std::unique_ptr<Progress> progress = context.MakeProgress();
  const std::vector<VisitScene> scenes = Scenes(arguments);
  const std::vector<double> alphas = Chosen(arguments.alpha, {1e-1, 1e-2, 1e-3});
  std::vector<Row> rows;
  for (const double alpha : alphas) {
    for (const VisitScene& scene : scenes) {
      HypothesisOptions options;
      options.alpha = alpha;
      options.max_leaves = arguments.max_leaves;
      rows.push_back(
          {scene,
           alpha,
           TallyDecisions(scene, options, arguments.seed, arguments.visits, arguments.threads)});
      progress->Update(
          "visits",
          static_cast<double>(rows.size()) / static_cast<double>(alphas.size() * scenes.size()));
    }
  }
  const ResultTable table = MakeTable(rows);
  SHIFTMAP_RETURN_IF_ERROR(
      output.WritePage("Wrong decisions and their delay over simulated visits", table));
  // Blind drives begin at one pose.
  if (!arguments.blind) {
    SHIFTMAP_RETURN_IF_ERROR(output.WriteFigure("wrong", WrongShareChart(rows)));
  }
  const Json options{{"visits", arguments.visits},
                     {"seed", arguments.seed},
                     {"max_leaves", arguments.max_leaves},
                     {"groups", arguments.groups},
                     {"sd_mode_m", arguments.sd_mode_m},
                     {"outlier_share", arguments.outlier_share},
                     {"blind", arguments.blind},
                     {"slip_share", arguments.slip_share},
                     {"alone_scans", arguments.alone_scans}};
  return output.Report(options, table, &context);
}

}  // namespace

void AddLocalizerDecisionsExperiment(Application* application) {
  auto arguments = std::make_shared<Arguments>();
  application
      ->AddCommand("localizer-decisions",
                   "Share of wrong decisions and their delay over simulated visits",
                   [arguments](Context& context) { return Measure(*arguments, context); })
      .Option("--output", &arguments->output, "Folder for CSV, JSON, SVG and a page")
      .Required()
      .Option("--visits", &arguments->visits, "Simulated visits per row")
      .InRange(1, 10000000)
      .Option("--groups", &arguments->groups, "Landmarks per visit")
      .InRange(1, 12)
      .Option("--sd-mode-m", &arguments->sd_mode_m, "Uncertainty of the map [m]")
      .InRange(1e-3, 1.0)
      .Option("--outlier-share", &arguments->outlier_share, "Share of detections at six sigma")
      .InRange(0.0, 0.5)
      .Flag("--blind", &arguments->blind, "Visits after 5 to 60 s without a sighting")
      .Option("--slip-share", &arguments->slip_share, "Of these stretches: in which wheels slip")
      .InRange(0.0, 1.0)
      .Option("--alone-scans", &arguments->alone_scans, "And after them: with one landmark in view")
      .InRange(0, 40)
      .Option("--alpha", &arguments->alpha, "This bound on wrong decisions alone; default: three")
      .InRange(1e-6, 0.4)
      .Option("--sd-pose-m", &arguments->sd_pose_m, "This start alone; default: four [m]")
      .InRange(1e-3, 10.0)
      .Option("--modes", &arguments->modes, "This number of modes alone; default: 2, 3 and 4")
      .InRange(1, 7)
      .Option("--clutter-per-m2", &arguments->clutter_per_m2, "These false alarms; default: two")
      .InRange(1e-9, 1.0)
      .Option("--max-leaves", &arguments->max_leaves, "Hypotheses kept at most")
      .InRange(1, 10000)
      .Option("--threads", &arguments->threads, "Threads; the results do not depend on it")
      .InRange(1, 64)
      .Option("--seed", &arguments->seed, "Seed of the first visit")
      .Writes();
}

}  // namespace shiftmap
