// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/localizer_bodies_command.h"

#include <array>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>

#include "tools/convert/utias.h"
#include "tools/experiment/experiment_output.h"
#include "tools/experiment/localizer_bodies.h"

namespace shiftmap {
namespace {

struct Arguments {
  std::string data;
  std::string output;
  int draws = 3;
  int threads = 1;
  std::uint64_t seed = 1;
  LayoutOptions options = DisplacedOptions();
};

struct Row {
  std::string kind;
  DisplacedPart part;
  double displaced_m;

  bool Body() const { return part == DisplacedPart::kRack || part == DisplacedPart::kSide; }
};

std::vector<Row> Rows() {
  std::vector<Row> rows = {{"none", DisplacedPart::kNothing, 0.0}};
  for (const double displaced : {0.7, 1.5, 3.0}) {
    rows.push_back({"rack", DisplacedPart::kRack, displaced});
    rows.push_back({"side", DisplacedPart::kSide, displaced});
  }
  rows.push_back({"layout", DisplacedPart::kLayout, 0.0});
  return rows;
}

StatusOr<UtiasRecordings> LoadRecordings(const std::string& data) {
  UtiasRecordings recordings;
  for (const auto& [dataset, robots] : kUtiasRobots) {
    const auto layout = static_cast<int>(recordings.layouts.size());
    SHIFTMAP_ASSIGN_OR_RETURN(
        Layout places, ReadUtiasLandmarks(data + "/MRCLAM_Dataset" + std::to_string(dataset)));
    recordings.layouts.push_back(std::move(places));
    for (const int robot : robots) {
      SHIFTMAP_ASSIGN_OR_RETURN(TrueShift shift, LoadUtiasShift(data, dataset, robot, layout));
      recordings.shifts.push_back(std::move(shift));
    }
  }
  return recordings;
}

double Share(std::int64_t part, std::int64_t of) {
  return static_cast<double>(part) / static_cast<double>(of);
}

void AddRow(const std::string& kind,
            double displaced_m,
            const DisplacedTally& tally,
            ResultTable* table) {
  table->AddRow({kind,
                 displaced_m,
                 static_cast<double>(tally.runs),
                 static_cast<double>(tally.poses),
                 Share(tally.wrong, tally.poses),
                 Share(tally.sure, tally.poses),
                 Share(tally.lost, tally.poses),
                 Share(tally.unknown, tally.poses),
                 tally.worst_m,
                 static_cast<double>(tally.decisions),
                 static_cast<double>(tally.wrong_decisions),
                 tally.nees_sum / static_cast<double>(tally.poses)});
}

Status Measure(const Arguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      ExperimentOutput output,
      ExperimentOutput::Create("localizer-bodies", arguments.output, context.dry_run()));
  const std::unique_ptr<Progress> progress = context.MakeProgress();
  progress->Update("calibration", 0.0);
  SHIFTMAP_ASSIGN_OR_RETURN(const Calibration calibration, MappedCalibration(arguments.data));
  SHIFTMAP_ASSIGN_OR_RETURN(const UtiasRecordings recordings, LoadRecordings(arguments.data));
  ResultTable table({"kind",
                     "displaced_m",
                     "runs",
                     "poses",
                     "wrong_share",
                     "sure_share",
                     "lost_share",
                     "unknown_share",
                     "worst_m",
                     "decisions",
                     "wrong_decisions",
                     "nees"});
  Chart chart{.title = "Wrong poses that are stated as sure",
              .x_label = "displacement of the landmarks [m]",
              .y_label = "share of poses"};
  const std::vector<Row> rows = Rows();
  const LayoutOptions& options = arguments.options;
  std::uint64_t seed = arguments.seed;
  DisplacedTally bodies;
  for (const Row& row : rows) {
    const std::vector<DisplacedRun> runs =
        DrawDisplacedRuns(recordings, row.part, row.displaced_m, arguments.draws, options, &seed);
    SHIFTMAP_ASSIGN_OR_RETURN(const DisplacedTally tally,
                              TallyDisplaced(runs, calibration, options, arguments.threads));
    AddRow(row.kind, row.displaced_m, tally, &table);
    if (row.Body()) {
      bodies.Add(tally);
      SeriesNamed(row.kind, &chart)
          .points.emplace_back(row.displaced_m, Share(tally.sure, tally.poses));
    }
    progress->Update("maps",
                     Share(static_cast<std::int64_t>(table.rows().size()),
                           static_cast<std::int64_t>(rows.size())));
  }
  AddRow("all bodies", std::numeric_limits<double>::quiet_NaN(), bodies, &table);
  SHIFTMAP_RETURN_IF_ERROR(
      output.WritePage("Recorded robots among landmarks that moved together", table));
  SHIFTMAP_RETURN_IF_ERROR(output.WriteFigure("sure", chart));
  const Json document_options{{"draws", arguments.draws},
                              {"seed", arguments.seed},
                              {"stale_probability", options.stale_probability},
                              {"sd_start_m", options.sd_start_m},
                              {"sd_start_rad", options.sd_start_rad},
                              {"sd_survey_m", options.sd_survey_m},
                              {"settled_after_s", options.settled_after_s}};
  return output.Report(document_options, table, &context);
}

}  // namespace

void AddLocalizerBodiesExperiment(Application* application) {
  auto arguments = std::make_shared<Arguments>();
  application
      ->AddCommand("localizer-bodies",
                   "Recorded robots on maps in which landmarks are displaced together",
                   [arguments](Context& context) { return Measure(*arguments, context); })
      .Option("--data", &arguments->data, "Folder with MRCLAM_Dataset1, 2, 3 and 6")
      .Required()
      .Option("--output", &arguments->output, "Folder for CSV, JSON, SVG and a page")
      .Required()
      .Option("--draws", &arguments->draws, "Displaced maps per robot and row")
      .InRange(1, 1000)
      .Option("--threads", &arguments->threads, "Threads; the results do not depend on it")
      .InRange(1, 64)
      .Option("--seed", &arguments->seed, "Seed of the first run")
      .Writes();
}

}  // namespace shiftmap
