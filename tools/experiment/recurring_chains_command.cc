// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/recurring_chains_command.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <numeric>
#include <string>
#include <vector>

#include "mapper/chain/learn_rhythm.h"
#include "tools/experiment/experiment_output.h"
#include "tools/experiment/recurring_chains.h"

namespace shiftmap {
namespace {

constexpr int kHours = 24;
constexpr char kGapLabel[] = "gap between training visits [log10 min]";

struct Arguments {
  std::string data;
  std::string output;
  RecurringChainsOptions options;
};

ResultTable MakeTable(const std::vector<RecurringChainsRow>& rows) {
  ResultTable table({"record",
                     "train",
                     "test",
                     "method",
                     "nats_per_hour",
                     "leave_per_day",
                     "low_per_day",
                     "high_per_day",
                     "train_visits",
                     "rhythm_hours"});
  for (const RecurringChainsRow& row : rows) {
    table.AddRow({row.record,
                  row.train,
                  row.test,
                  row.method,
                  row.nats_per_hour,
                  row.leave_per_day,
                  row.low_per_day,
                  row.high_per_day,
                  row.train_visits,
                  row.rhythm_hours});
  }
  return table;
}

// A line per method over the gap of the training visits; those at random have no place on it.
Chart OverGap(const std::vector<RecurringChainsRow>& rows,
              const RecurringChainsOptions& options,
              const std::string& record,
              const std::string& test,
              double RecurringChainsRow::*member,
              Chart chart) {
  for (const RecurringChainsRow& row : rows) {
    if (row.record != record || row.test != test) continue;
    const auto spacing =
        std::find_if(options.train.begin(), options.train.end(), [&](const VisitSpacing& other) {
          return other.name == row.train;
        });
    if (spacing == options.train.end() || !(spacing->gap_s > 0.0)) continue;
    if (!std::isfinite(row.*member)) continue;
    SeriesNamed(row.method, &chart)
        .points.emplace_back(std::log10(spacing->gap_s / 60.0), row.*member);
  }
  return chart;
}

Status WriteFigures(const std::vector<RecurringChainsRow>& rows,
                    const std::vector<std::string>& records,
                    const RecurringChainsOptions& options,
                    ExperimentOutput* output) {
  for (const std::string& record : records) {
    std::string stem = record;
    std::replace(stem.begin(), stem.end(), ' ', '-');
    const Chart predicted{.title = fmt::format("Held-out minutes, {}", record),
                          .x_label = kGapLabel,
                          .y_label = "log-likelihood per hour [nat]"};
    SHIFTMAP_RETURN_IF_ERROR(output->WriteFigure(stem + "-predicted",
                                                 OverGap(rows,
                                                         options,
                                                         record,
                                                         options.test.front().name,
                                                         &RecurringChainsRow::nats_per_hour,
                                                         predicted)));
    const Chart rates{.title = fmt::format("Mean leave rate, {}", record),
                      .x_label = kGapLabel,
                      .y_label = "rate [1/day]",
                      .log_y = true};
    SHIFTMAP_RETURN_IF_ERROR(output->WriteFigure(stem + "-rates",
                                                 OverGap(rows,
                                                         options,
                                                         record,
                                                         options.test.front().name,
                                                         &RecurringChainsRow::leave_per_day,
                                                         rates)));
  }
  return OkStatus();
}

ChainHistory WholeHistory(const RecurringRecord& record) {
  std::vector<std::size_t> all(record.stamps.size());
  std::iota(all.begin(), all.end(), std::size_t{0});
  return VisitRecord(record, all);
}

StatusOr<LearnedChain> LearnGeneralChain(const ChainHistory& history,
                                         ChainLearningOptions learning) {
  learning.structure = ChainStructure::kGeneral;
  return LearnChain(history, learning);
}

// How the door's rates go with the hour.
StatusOr<Chart> RhythmChart(const RecurringRecord& door, const RecurringChainsOptions& options) {
  const ChainHistory history = WholeHistory(door);
  SHIFTMAP_ASSIGN_OR_RETURN(const LearnedChain whole, LearnGeneralChain(history, options.learning));
  const std::vector<ModeChain> chains =
      FitPhases(history, {kRhythmDay, kHours}, {kHours, whole.chain}, {});
  Chart chart{.title = "The door by the hour",
              .x_label = "hour of the day [UTC]",
              .y_label = "rate [1/h]",
              .series = {{"opens", {}, true}, {"closes", {}, true}},
              .log_y = true};
  for (std::size_t phase = 0; phase < chains.size(); ++phase) {
    const double hour = 24.0 * (static_cast<double>(phase) + 0.5) / kHours;
    chart.series[0].points.emplace_back(hour, 3600.0 * chains[phase].rate_matrix()(0, 1));
    chart.series[1].points.emplace_back(hour, 3600.0 * chains[phase].rate_matrix()(1, 0));
  }
  return chart;
}

Json OptionsJson(const RecurringChainsOptions& options) {
  return {{"seed", options.seed},
          {"train_share", options.train_share},
          {"hand_set_change", options.hand_set_change},
          {"prior",
           {{"shape", options.learning.prior.shape},
            {"exposure_s", options.learning.prior.exposure_s}}},
          {"interval", options.learning.interval}};
}

Status Run(const Arguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      ExperimentOutput output,
      ExperimentOutput::Create("recurring-chains", arguments.output, context.dry_run()));
  SHIFTMAP_ASSIGN_OR_RETURN(const RecurringRecord door,
                            ReadDoorRecord(arguments.data + "/office_door_2016_jan_mar.txt"));
  SHIFTMAP_ASSIGN_OR_RETURN(
      const RecurringRecord rooms,
      ReadRoomRecord(arguments.data + "/aruba_room_per_minute_first_56_days.txt"));
  const RecurringChainsOptions& options = arguments.options;

  // The truth of the simulated record is the chain of the real one.
  SHIFTMAP_ASSIGN_OR_RETURN(const LearnedChain truth,
                            LearnGeneralChain(WholeHistory(rooms), options.learning));
  const RecurringRecord simulated = SimulateRecord(rooms, truth.chain, options.seed);

  const std::unique_ptr<Progress> progress = context.MakeProgress();
  std::vector<RecurringChainsRow> rows;
  std::vector<std::string> records;
  for (const RecurringRecord* record : {&door, &rooms, &simulated}) {
    SHIFTMAP_ASSIGN_OR_RETURN(
        const std::vector<RecurringChainsRow> more,
        CompareChains(
            *record, record == &simulated ? &truth.chain : nullptr, options, [&](double done) {
              progress->Update(record->name, done);
            }));
    rows.insert(rows.end(), more.begin(), more.end());
    records.push_back(record->name);
  }

  const ResultTable table = MakeTable(rows);
  SHIFTMAP_RETURN_IF_ERROR(WriteFigures(rows, records, options, &output));
  SHIFTMAP_ASSIGN_OR_RETURN(const Chart rhythm, RhythmChart(door, options));
  SHIFTMAP_RETURN_IF_ERROR(output.WriteFigure("door-rhythm", rhythm));
  return output.Report(OptionsJson(options), table, &context);
}

}  // namespace

void AddRecurringChainsExperiment(Application* application) {
  auto arguments = std::make_shared<Arguments>();
  application
      ->AddCommand("recurring-chains",
                   "Learned mode chains on a real door and a person's rooms, held-out",
                   [arguments](Context& context) { return Run(*arguments, context); })
      .Option("--data", &arguments->data, "Folder of the records of the door and the rooms")
      .Required()
      .Option("--output", &arguments->output, "Folder for CSV, JSON and SVG")
      .Required()
      .Option("--seed", &arguments->options.seed, "Seed of everything random")
      .Writes();
}

}  // namespace shiftmap
