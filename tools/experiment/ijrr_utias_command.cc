// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/ijrr_utias_command.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "tools/experiment/experiment_output.h"
#include "tools/experiment/ijrr_utias.h"
#include "tools/experiment/ijrr_utias_pictures.h"
#include "tools/experiment/mcts_options.h"

namespace shiftmap {
namespace {

// Of the displacements of IJRR figure 9, those of a quick run.
const std::vector<double> kQuickDeltas = {0.0, 0.3, 1.0, 2.5};

struct Arguments {
  std::string output;
  std::vector<std::string> datasets;
  std::vector<std::string> robots;
  std::vector<std::string> starts;
  std::vector<std::string> deltas;
  bool quick = false;
  IjrrUtiasOptions options;
};

// Numbers of at least `least`.
template <typename Number>
StatusOr<std::vector<Number>> ParseNumbers(const std::vector<std::string>& texts,
                                           Number least,
                                           const char* what) {
  std::vector<Number> numbers;
  for (const std::string& text : texts) {
    Number number{};
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
    if (error != std::errc() || end != text.data() + text.size() || !(number >= least)) {
      return InvalidArgument("{} '{}', expected a number from {} on", what, text, least);
    }
    numbers.push_back(number);
  }
  return numbers;
}

StatusOr<IjrrUtiasOptions> MakeOptions(const Arguments& arguments) {
  IjrrUtiasOptions options = arguments.options;
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<int> datasets,
                            ParseNumbers(arguments.datasets, 1, "data set"));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<int> robots,
                            ParseNumbers(arguments.robots, 1, "robot"));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<double> starts,
                            ParseNumbers(arguments.starts, 0.0, "start"));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<double> deltas,
                            ParseNumbers(arguments.deltas, 0.0, "displacement"));
  if (!datasets.empty()) options.datasets = datasets;
  if (!robots.empty()) options.robots = robots;
  if (!starts.empty()) options.starts_s = starts;
  if (options.more_modes && datasets.empty()) options.datasets = {1};
  if (arguments.quick) {
    options.deltas_m = kQuickDeltas;
    if (options.methods.empty()) {
      for (const IjrrUtiasMethod& method : IjrrUtiasMethods()) {
        if (!method.slow) options.methods.push_back(method.name);
      }
    }
  }
  if (!deltas.empty()) options.deltas_m = deltas;
  return options;
}

// Data set, robot, start and displacement: what methods are compared on.
auto CaseOf(const IjrrUtiasRow& row) {
  return std::tuple(row.dataset, row.robot, row.start_s, row.delta_m);
}

// Processor time of the least-squares static solve on the same run with the same displacement.
double StaticSeconds(const std::vector<IjrrUtiasRow>& rows, const IjrrUtiasRow& of) {
  for (const IjrrUtiasRow& row : rows) {
    if (CaseOf(row) == CaseOf(of) && row.method == "static") return row.cpu_s;
  }
  return std::nan("");
}

ResultTable MakeTable(const std::vector<IjrrUtiasRow>& rows) {
  ResultTable table({"dataset",
                     "robot",
                     "start_s",
                     "delta_m",
                     "method",
                     "realizations",
                     "pose_rmse_m",
                     "pose_rmse_se_m",
                     "step_pose_rmse_m",
                     "landmark_rmse_m",
                     "landmark_rmse_se_m",
                     "modes",
                     "created",
                     "full_optimizations",
                     "waits",
                     "truth_probability",
                     "cpu_s",
                     "frames",
                     "frames_per_s",
                     "times_static"});
  for (const IjrrUtiasRow& row : rows) {
    table.AddRow({static_cast<double>(row.dataset),
                  static_cast<double>(row.robot),
                  row.start_s,
                  row.delta_m,
                  row.method,
                  static_cast<double>(row.realizations),
                  row.pose_rmse_m,
                  row.pose_rmse_se_m,
                  row.step_pose_rmse_m,
                  row.landmark_rmse_m,
                  row.landmark_rmse_se_m,
                  row.modes,
                  row.created,
                  row.full_optimizations,
                  row.waits ? 1.0 : 0.0,
                  row.truth_probability.value_or(std::nan("")),
                  row.cpu_s,
                  static_cast<double>(row.frames),
                  row.frames / row.cpu_s,
                  row.cpu_s / StaticSeconds(rows, row)});
  }
  return table;
}

// IJRR table 1: mean processor time per method and data set over displacements and robots.
ResultTable MakeTimes(const std::vector<IjrrUtiasRow>& rows) {
  ResultTable times({"method", "dataset", "mean_cpu_s", "frames_per_s"});
  for (const IjrrUtiasMethod& method : IjrrUtiasMethods()) {
    std::map<int, std::pair<double, double>> sums;  // Per data set: seconds, frames.
    std::map<int, int> counts;
    for (const IjrrUtiasRow& row : rows) {
      if (row.method != method.name) continue;
      sums[row.dataset].first += row.cpu_s;
      sums[row.dataset].second += row.frames;
      ++counts[row.dataset];
    }
    for (const auto& [dataset, sum] : sums) {
      times.AddRow({method.name,
                    static_cast<double>(dataset),
                    sum.first / counts[dataset],
                    sum.second / sum.first});
    }
  }
  return times;
}

// What a build makes of a displacement, beside a map that is told which landmarks it has wrong.
struct Verdicts {
  int cases = 0;
  int as_oracle = 0;     // Its error is within 15 % or 2 cm.
  int waits = 0;         // The truth is among its explanations.
  int kept = 0;          // It is in the map, with the truth among the explanations.
  int wrong = 0;         // None of these.
  int oracle_waits = 0;  // Even then it is not decided.
};

bool IsAsOracle(const IjrrUtiasRow& row, const IjrrUtiasRow& oracle) {
  // Where motion capture has no poses.
  const bool has_poses = std::isfinite(oracle.pose_rmse_m);
  const double error_m = has_poses ? row.pose_rmse_m : row.landmark_rmse_m;
  const double of_oracle_m = has_poses ? oracle.pose_rmse_m : oracle.landmark_rmse_m;
  return error_m <= std::max(1.15 * of_oracle_m, of_oracle_m + 0.02);
}

ResultTable MakeVerdicts(const std::vector<IjrrUtiasRow>& rows) {
  std::map<decltype(CaseOf(rows.front())), const IjrrUtiasRow*> oracles;
  for (const IjrrUtiasRow& row : rows) {
    if (row.method == "oracle") oracles[CaseOf(row)] = &row;
  }
  std::map<double, Verdicts> by_delta;
  for (const IjrrUtiasRow& row : rows) {
    const auto oracle = oracles.find(CaseOf(row));
    if (row.method != "ours" || oracle == oracles.end()) continue;
    Verdicts& verdicts = by_delta[row.delta_m];
    ++verdicts.cases;
    const bool has_truth = row.truth_probability.value_or(0.0) > 0.0;
    if (oracle->second->waits) {
      ++verdicts.oracle_waits;
    } else if (row.waits && has_truth) {
      ++verdicts.waits;
    } else if (!row.waits && IsAsOracle(row, *oracle->second)) {
      ++verdicts.as_oracle;
    } else if (has_truth) {
      ++verdicts.kept;
    } else {
      ++verdicts.wrong;
    }
  }
  ResultTable table({"delta_m", "cases", "as_oracle", "waits", "kept", "wrong", "oracle_waits"});
  for (const auto& [delta_m, verdicts] : by_delta) {
    std::vector<ResultTable::Cell> row = {delta_m};
    for (const int count : {verdicts.cases,
                            verdicts.as_oracle,
                            verdicts.waits,
                            verdicts.kept,
                            verdicts.wrong,
                            verdicts.oracle_waits}) {
      row.emplace_back(static_cast<double>(count));
    }
    table.AddRow(row);
  }
  return table;
}

// A line per method of a figure: one member of the rows of a data set over the displacement, mean
// over robots.
Chart OverDisplacement(const std::vector<IjrrUtiasRow>& rows,
                       int dataset,
                       const std::string& figure,
                       double IjrrUtiasRow::*member,
                       Chart chart) {
  for (const IjrrUtiasMethod& method : IjrrUtiasMethods()) {
    if (method.figure != figure) continue;
    std::map<double, std::pair<double, int>> sums;
    for (const IjrrUtiasRow& row : rows) {
      if (row.dataset != dataset || row.method != method.name) continue;
      if (!std::isfinite(row.*member)) continue;
      sums[row.delta_m].first += row.*member;
      ++sums[row.delta_m].second;
    }
    if (sums.empty()) continue;
    ChartSeries& series = chart.series.emplace_back();
    series.name = method.name;
    for (const auto& [delta_m, sum] : sums) {
      series.points.emplace_back(delta_m, sum.first / sum.second);
    }
  }
  return chart;
}

// The displacement of the pictures of a data set: of those that ran, the nearest to that of IJRR
// figures 8 and 11.
double PictureDelta(const IjrrUtiasOptions& options, int dataset) {
  const double paper_m = dataset == 2 ? 2.1 : 1.0;
  return *std::min_element(
      options.deltas_m.begin(), options.deltas_m.end(), [&](double a, double b) {
        return std::abs(a - paper_m) < std::abs(b - paper_m);
      });
}

Status WritePictures(const IjrrUtiasOptions& options,
                     const IjrrUtiasResult& result,
                     ExperimentOutput* output) {
  for (const UtiasCase& data : result.cases) {
    const double delta_m = PictureDelta(options, data.dataset);
    std::vector<const IjrrUtiasRow*> rows;
    for (const IjrrUtiasRow& row : result.rows) {
      if (row.dataset == data.dataset && row.robot == data.robot && row.delta_m == delta_m) {
        rows.push_back(&row);
      }
    }
    if (rows.empty()) continue;
    const std::string name = fmt::format("set{}-robot{}", data.dataset, data.robot);
    SHIFTMAP_RETURN_IF_ERROR(output->WriteFigure(name + "-paths", DrawPaths(data, rows)));
    SHIFTMAP_RETURN_IF_ERROR(output->WriteFigure(name + "-modes", DrawCreatedModes(data, rows)));
  }
  return OkStatus();
}

Status WriteFigures(const IjrrUtiasOptions& options,
                    const std::vector<IjrrUtiasRow>& rows,
                    ExperimentOutput* output) {
  const std::vector<std::pair<std::string, double IjrrUtiasRow::*>> members = {
      {"pose", &IjrrUtiasRow::pose_rmse_m}, {"landmark", &IjrrUtiasRow::landmark_rmse_m}};
  for (const int dataset : options.datasets) {
    for (const auto& [name, member] : members) {
      for (const std::string figure : {"printed", "calibrated"}) {
        const Chart chart = OverDisplacement(
            rows,
            dataset,
            figure,
            member,
            {.title = fmt::format("Data set {}: {} RMSE, noise as {}", dataset, name, figure),
             .x_label = "displacement of the moved landmarks [m]",
             .y_label = "RMSE [m]",
             .log_y = true});
        if (chart.series.empty()) continue;
        SHIFTMAP_RETURN_IF_ERROR(
            output->WriteFigure(fmt::format("set{}-{}-{}", dataset, name, figure), chart));
      }
    }
  }
  return OkStatus();
}

Json OptionsJson(const IjrrUtiasOptions& options, const IjrrUtiasResult& result) {
  Json cases = Json::array();
  for (const UtiasCase& data : result.cases) {
    Json moved = Json::array();
    for (const Signature& signature : data.moved) moved.push_back(signature.text());
    cases.push_back({{"dataset", data.dataset},
                     {"robot", data.robot},
                     {"begin_s", ToSecondsSinceEpoch(data.run.odometry.front().stamp)},
                     {"frames", data.frames.frames.size()},
                     {"sightings", data.frames.sightings.size()},
                     {"moved", moved}});
  }
  return {{"cases", cases},
          {"starts_s", options.starts_s},
          {"duration_s", options.protocol.duration_s},
          {"max_range_m", options.protocol.max_range_m},
          {"max_bearing_rad", options.protocol.max_bearing_rad},
          {"prior_sd_m", options.protocol.prior_sd_m},
          {"more_modes", options.more_modes},
          {"gate", options.gate_probability ? Json(*options.gate_probability) : Json(nullptr)},
          {"seed", options.seed},
          {"realizations", options.realizations},
          {"mcts", MctsJson(options.mcts)},
          {"times", RowsJson(MakeTimes(result.rows))}};
}

Status RunExperiment(const Arguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      ExperimentOutput output,
      ExperimentOutput::Create("ijrr-utias", arguments.output, context.dry_run()));
  SHIFTMAP_ASSIGN_OR_RETURN(const IjrrUtiasOptions options, MakeOptions(arguments));
  const std::unique_ptr<Progress> progress = context.MakeProgress();
  SHIFTMAP_ASSIGN_OR_RETURN(const IjrrUtiasResult result,
                            RunIjrrUtias(options, [&](const std::string& what, double done) {
                              progress->Update(what, done);
                            }));
  const ResultTable table = MakeTable(result.rows);
  SHIFTMAP_RETURN_IF_ERROR(output.WriteTable(table));
  if (options.starts_s.size() == 1) {  // Else methods would be means over different cases.
    SHIFTMAP_RETURN_IF_ERROR(WriteFigures(options, result.rows, &output));
    SHIFTMAP_RETURN_IF_ERROR(WritePictures(options, result, &output));
  }
  const ResultTable verdicts = MakeVerdicts(result.rows);
  if (!verdicts.rows().empty()) {
    SHIFTMAP_RETURN_IF_ERROR(output.WritePage(
        "Builds on a map that has landmarks displaced, beside one that is told which", verdicts));
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const Json document,
                            output.WriteDocument(OptionsJson(options, result), table));
  context.Report(document, table.ToText() + "\n" + MakeTimes(result.rows).ToText());
  return OkStatus();
}

}  // namespace

void AddIjrrUtiasExperiment(Application* application) {
  auto arguments = std::make_shared<Arguments>();
  Command& command = application->AddCommand(
      "ijrr-utias",
      "Recorded runs among displaced landmarks, IJRR 8.2 and 8.3: every method",
      [arguments](Context& context) { return RunExperiment(*arguments, context); });
  command.Option("--data", &arguments->options.data, "Folder that holds MRCLAM_Dataset<N>")
      .Required()
      .Option("--output", &arguments->output, "Folder for CSV, JSON and SVG")
      .Required()
      .Option("--datasets", &arguments->datasets, "Numbers of the data sets; default 1 2 3")
      .Option("--robots", &arguments->robots, "Numbers of the robots; default 1")
      .Option("--deltas", &arguments->deltas, "Displacements in metres; default those of figure 9")
      .Option("--methods", &arguments->options.methods, "Only these methods")
      .Option("--start-s",
              &arguments->starts,
              "Where in the recording to begin [s], one or several; the paper, and default: 0")
      .Option("--prior-sd-m",
              &arguments->options.protocol.prior_sd_m,
              "Standard deviation of each coordinate in the map")
      .InRange(1e-4, 1e2)
      .Option("--gate",
              &arguments->options.gate_probability,
              "Gate of the paper's selectors; default 0.95")
      .Option("--realizations",
              &arguments->options.realizations,
              "Of nn and mcts, whose means and standard errors are given; IJRR 8.2.3: 12")
      .InRange(1, 1e6)
      .Option("--threads", &arguments->options.threads, "Realizations side by side")
      .InRange(1, 1024)
      .Option("--seed", &arguments->options.seed, "Seed of the first realization")
      .Flag("--more-modes",
            &arguments->options.more_modes,
            "Change probability 0.1 and gate 0.8 as in IJRR 8.2.4; data set 1")
      .Flag("--quick", &arguments->quick, "Fewer displacements, and no tree search but in a window")
      .Writes();
  AddMctsOptions(&arguments->options.mcts, &command);
}

}  // namespace shiftmap
