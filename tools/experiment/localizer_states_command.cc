// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/localizer_states_command.h"

#include <fmt/format.h>

#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tools/experiment/experiment_output.h"
#include "tools/experiment/localizer_states.h"
#include "tools/plot/svg.h"

namespace shiftmap {
namespace {

struct Arguments {
  std::string output;
  int shifts = 200;
  int threads = 2;
  std::uint64_t seed = 1;
};

ResultTable MakeTable(const std::vector<CauseTally>& tallies) {
  std::vector<std::string> columns = {"cause", "shifts"};
  for (std::size_t i = 0; i < kReportColumns; ++i) columns.push_back(ReportColumn(i));
  for (const char* name : {"confused", "pose_wrong", "said_before", "recovered", "delay_s"}) {
    columns.push_back(name);
  }
  ResultTable table(columns);
  for (const CauseTally& tally : tallies) {
    std::vector<ResultTable::Cell> row = {std::string(ToString(tally.cause)),
                                          static_cast<double>(tally.shifts)};
    for (const std::int64_t count : tally.reported) row.emplace_back(static_cast<double>(count));
    row.emplace_back(static_cast<double>(tally.confused));
    row.emplace_back(static_cast<double>(tally.pose_wrong));
    row.emplace_back(static_cast<double>(tally.said_before));
    row.emplace_back(static_cast<double>(tally.recovered));
    row.emplace_back(tally.delay_s);
    table.AddRow(std::move(row));
  }
  return table;
}

// A row per cause, a column per report; the darker, the more shifts.
std::string DrawMatrix(const std::vector<CauseTally>& tallies) {
  constexpr double kLeft = 150.0;
  constexpr double kTop = 70.0;
  constexpr double kCellWidth = 130.0;
  constexpr double kCellHeight = 34.0;
  Svg svg(kLeft + kCellWidth * static_cast<double>(kReportColumns) + 20.0,
          kTop + kCellHeight * static_cast<double>(tallies.size()) + 20.0);
  svg.Text({kLeft, 24.0}, "Reported after the cause (shifts)", {.size = 15.0, .bold = true});
  for (std::size_t column = 0; column < kReportColumns; ++column) {
    const double x = kLeft + kCellWidth * (static_cast<double>(column) + 0.5);
    svg.Text({x, kTop - 10.0}, ReportColumn(column), {.size = 10.0, .anchor = SvgAnchor::kMiddle});
  }
  for (std::size_t row = 0; row < tallies.size(); ++row) {
    const CauseTally& tally = tallies[row];
    const double y = kTop + kCellHeight * static_cast<double>(row);
    svg.Text({kLeft - 10.0, y + 22.0}, ToString(tally.cause), {.anchor = SvgAnchor::kEnd});
    for (std::size_t column = 0; column < kReportColumns; ++column) {
      const double x = kLeft + kCellWidth * static_cast<double>(column);
      const double share =
          static_cast<double>(tally.reported[column]) / static_cast<double>(tally.shifts);
      svg.Rect({x, y},
               {kCellWidth, kCellHeight},
               {.stroke = "#bbbbbb", .fill = "#0072B2", .opacity = 0.05 + 0.95 * share});
      if (tally.reported[column] == 0) continue;
      svg.Text({x + 0.5 * kCellWidth, y + 22.0},
               std::to_string(tally.reported[column]),
               {.fill = share > 0.5 ? "#ffffff" : "#222222", .anchor = SvgAnchor::kMiddle});
    }
  }
  return svg.ToString();
}

Json OptionsJson(const Arguments& arguments) {
  return {{"seed", arguments.seed}, {"shifts", arguments.shifts}};
}

Status RunLocalizerStates(const Arguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      ExperimentOutput output,
      ExperimentOutput::Create("localizer-states", arguments.output, context.dry_run()));
  const std::unique_ptr<Progress> progress = context.MakeProgress();
  std::vector<CauseTally> tallies;
  for (std::size_t i = 0; i < kShiftCauses; ++i) {
    const auto cause = static_cast<ShiftCause>(i);
    progress->Update(ToString(cause), static_cast<double>(i) / static_cast<double>(kShiftCauses));
    tallies.push_back(
        TallyCause(cause, arguments.seed, arguments.shifts, arguments.threads, LocalizerOptions()));
  }
  const ResultTable table = MakeTable(tallies);
  SHIFTMAP_RETURN_IF_ERROR(
      output.WritePage("Shifts by what the localizer reported, the worst after the cause", table));
  SHIFTMAP_RETURN_IF_ERROR(output.WritePicture("matrix", DrawMatrix(tallies)));
  return output.Report(OptionsJson(arguments), table, &context);
}

}  // namespace

void AddLocalizerStatesExperiment(Application* application) {
  auto arguments = std::make_shared<Arguments>();
  application
      ->AddCommand(
          "localizer-states",
          "States that the localizer reports, over simulated shifts with known causes",
          [arguments](Context& context) { return RunLocalizerStates(*arguments, context); })
      .Option("--output", &arguments->output, "Folder for CSV, JSON, SVG and a page")
      .Required()
      .Option("--shifts", &arguments->shifts, "Shifts per cause")
      .InRange(1, 100000)
      .Option("--threads", &arguments->threads, "Threads")
      .InRange(1, 64)
      .Option("--seed", &arguments->seed, "Seed of the first shift")
      .Writes();
}

}  // namespace shiftmap
