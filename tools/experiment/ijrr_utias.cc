// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/ijrr_utias.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "mapper/mapper.h"
#include "mapper/parallel.h"
#include "tools/experiment/ijrr_utias_selectors.h"
#include "tools/experiment/ijrr_utias_static.h"
#include "tools/experiment/processor_time.h"
#include "tools/experiment/sample_mean.h"

namespace shiftmap {
namespace {

// Displacements between those of figure 9, at which only some methods run.
const std::vector<double> kFineDeltas = {0.1, 0.2};

/// A case with one displacement, ready for every method.
struct Trial {
  const UtiasCase* data = nullptr;
  LandmarkPlaces map;
  UtiasNoise calibrated;
  const IjrrUtiasOptions* options = nullptr;
  std::uint64_t seed = 1;  // Of the realization.

  Stamp begin() const { return data->run.odometry.front().stamp; }
};

StatusOr<MapperResult> Build(const UtiasCase& data, const std::optional<MapContent>& prior) {
  MapperInput input;
  input.name = fmt::format("set{}_robot{}", data.dataset, data.robot);
  input.sha256 = input.name;
  input.run = data.run;
  MapperOptions options;
  if (!prior) options.distortion_share = 0.0;  // The other methods take off a SensorBias alone.
  return BuildMap({std::move(input)}, prior, options);
}

StatusOr<UtiasEstimate> RunMapper(const Trial& trial, const LandmarkPlaces& map) {
  const MapContent prior = SurveyMap(map, trial.options->protocol.prior_sd_m, trial.begin());
  SHIFTMAP_ASSIGN_OR_RETURN(const MapperResult result, Build(*trial.data, prior));
  if (result.runs.empty() && result.ambiguous_changes.empty()) {
    return InvalidArgument("run rejected");
  }
  return FromMapperResult(*trial.data, result);
}

StatusOr<UtiasEstimate> RunOurs(const Trial& trial) { return RunMapper(trial, trial.map); }

// The map without what it has wrong: those landmarks are free.
StatusOr<UtiasEstimate> RunOracle(const Trial& trial) {
  LandmarkPlaces known = trial.map;
  for (const Signature& signature : trial.data->moved) known.erase(signature);
  return RunMapper(trial, known);
}

StatusOr<UtiasEstimate> RunStatic(const Trial& trial, StaticLoss loss) {
  return SolveStatic(
      *trial.data, trial.calibrated, trial.map, trial.options->protocol.prior_sd_m, loss);
}

struct Method {
  IjrrUtiasMethod about;
  std::function<StatusOr<UtiasEstimate>(const Trial&)> run;
};

// The paper's own sliding window, IJRR 8.3. [s]
constexpr double kWindowSeconds = 40.0;

// A selector as IJRR 8.2.2 has it, or 8.2.4.
StatusOr<UtiasEstimate> RunSelector(const Trial& trial,
                                    SelectorKind kind,
                                    const UtiasNoise& noise,
                                    double window_s) {
  const IjrrUtiasOptions& experiment = *trial.options;
  IncrementalOptions options = PrintedSelectorOptions(kind, noise, experiment.protocol);
  options.selector.mcts = experiment.mcts;
  options.selector.seed = trial.seed;
  options.window_s = window_s;
  if (experiment.more_modes) {
    options.change_probability = 0.1;
    options.gate_probability = 0.8;
  }
  options.gate_probability = experiment.gate_probability.value_or(options.gate_probability);
  return SolveFrameByFrame(*trial.data, noise, trial.map, experiment.protocol.prior_sd_m, options);
}

StatusOr<UtiasEstimate> RunIncremental(const Trial& trial, double window_s) {
  IncrementalOptions options = OwnSelectorOptions(trial.calibrated, trial.options->protocol);
  options.window_s = window_s;
  return SolveFrameByFrame(
      *trial.data, trial.calibrated, trial.map, trial.options->protocol.prior_sd_m, options);
}

// A selector four times: with either noise, over the whole run and in a window.
void AddSelector(SelectorKind kind, std::vector<Method>* methods) {
  const std::string name = SelectorName(kind);
  for (const bool printed : {true, false}) {
    for (const bool windowed : {false, true}) {
      const double window_s = windowed ? kWindowSeconds : std::numeric_limits<double>::infinity();
      IjrrUtiasMethod about;
      about.name = name + (printed ? "-printed" : "") + (windowed ? "-40s" : "");
      const bool search = kind == SelectorKind::kMcts;
      if (!windowed || search) about.figure = printed ? "printed" : "calibrated";
      about.slow = search && !windowed;
      about.random = search || kind == SelectorKind::kNearestNeighbor;
      methods->push_back({about, [kind, printed, window_s](const Trial& trial) {
                            const UtiasNoise noise =
                                printed ? PrintedNoise(trial.data->dataset) : trial.calibrated;
                            return RunSelector(trial, kind, noise, window_s);
                          }});
    }
  }
}

std::vector<Method> Methods() {
  std::vector<Method> methods = {
      {{"ours", "calibrated", true, false}, RunOurs},
      {{"oracle", "calibrated", true, false}, RunOracle},
      {{"static", "calibrated", true, false},
       [](const Trial& trial) { return RunStatic(trial, StaticLoss::kSquare); }},
      {{"static-cauchy", "calibrated", true, false},
       [](const Trial& trial) { return RunStatic(trial, StaticLoss::kCauchy); }},
      {{"incremental", "calibrated", true, false},
       [](const Trial& trial) {
         return RunIncremental(trial, std::numeric_limits<double>::infinity());
       }},
      {{"incremental-40s", "", true, false},
       [](const Trial& trial) { return RunIncremental(trial, kWindowSeconds); }}};
  for (const SelectorKind kind : {SelectorKind::kNearestNeighbor,
                                  SelectorKind::kEm,
                                  SelectorKind::kEmRecursive,
                                  SelectorKind::kMcts,
                                  SelectorKind::kMaxMixture,
                                  SelectorKind::kNoHypotheses,
                                  SelectorKind::kViterbi}) {
    AddSelector(kind, &methods);
  }
  return methods;
}

bool Selected(const IjrrUtiasOptions& options, const IjrrUtiasMethod& method, double delta_m) {
  const bool fine = std::find(kFineDeltas.begin(), kFineDeltas.end(), delta_m) != kFineDeltas.end();
  if (fine && !method.fine_deltas) return false;
  return options.methods.empty() ||
         std::find(options.methods.begin(), options.methods.end(), method.name) !=
             options.methods.end();
}

IjrrUtiasRow RunOnce(const Method& method, const Trial& trial, double delta_m) {
  IjrrUtiasRow row;
  row.dataset = trial.data->dataset;
  row.robot = trial.data->robot;
  row.start_s = trial.data->start_s;
  row.delta_m = delta_m;
  row.method = method.about.name;
  row.frames = static_cast<int>(trial.data->frames.frames.size());
  const double begin_s = ThreadProcessorSeconds();
  StatusOr<UtiasEstimate> estimate = method.run(trial);
  row.cpu_s = ThreadProcessorSeconds() - begin_s;
  row.pose_rmse_m = row.step_pose_rmse_m = row.landmark_rmse_m =
      std::numeric_limits<double>::quiet_NaN();
  if (!estimate.ok()) return row;
  row.truth_probability = ProbabilityOfTruth(*trial.data, *estimate);
  row.waits = estimate->poses.empty();
  if (row.waits) return row;
  const UtiasScore score = ScoreUtias(*trial.data, *estimate);
  row.pose_rmse_m = score.pose_rmse_m;
  if (!estimate->step_poses.empty()) row.step_pose_rmse_m = score.step_pose_rmse_m;
  row.landmark_rmse_m = score.landmark_rmse_m;
  row.modes = score.modes;
  row.created = estimate->created;
  row.full_optimizations = estimate->full_optimizations;
  row.estimate = *std::move(estimate);
  return row;
}

// Every realization of a method.
IjrrUtiasRow RunMethod(const Method& method, const Trial& trial, double delta_m) {
  const IjrrUtiasOptions& options = *trial.options;
  std::vector<IjrrUtiasRow> rows(
      static_cast<std::size_t>(method.about.random ? options.realizations : 1));
  ForEachIndex(rows.size(), options.threads, [&](std::size_t i) {
    Trial realization = trial;
    realization.seed = options.seed + i;
    rows[i] = RunOnce(method, realization, delta_m);
  });
  const auto mean = [&](double IjrrUtiasRow::*member) {
    std::vector<double> values;
    for (const IjrrUtiasRow& row : rows) values.push_back(row.*member);
    return MeanOf(values);
  };
  IjrrUtiasRow result = rows.front();
  result.realizations = static_cast<int>(rows.size());
  const SampleMean pose = mean(&IjrrUtiasRow::pose_rmse_m);
  const SampleMean landmark = mean(&IjrrUtiasRow::landmark_rmse_m);
  result.pose_rmse_m = pose.mean;
  result.pose_rmse_se_m = pose.standard_error;
  result.landmark_rmse_m = landmark.mean;
  result.landmark_rmse_se_m = landmark.standard_error;
  for (double IjrrUtiasRow::*member : {&IjrrUtiasRow::step_pose_rmse_m,
                                       &IjrrUtiasRow::modes,
                                       &IjrrUtiasRow::created,
                                       &IjrrUtiasRow::full_optimizations,
                                       &IjrrUtiasRow::cpu_s}) {
    result.*member = mean(member).mean;
  }
  return result;
}

// Every robot from every start, of each data set one at least.
StatusOr<std::vector<UtiasCase>> LoadCases(const IjrrUtiasOptions& options) {
  std::vector<UtiasCase> cases;
  for (const int dataset : options.datasets) {
    const std::size_t before = cases.size();
    Status missing;
    for (const int robot : options.robots) {
      for (const double start_s : options.starts_s) {
        UtiasProtocol protocol = options.protocol;
        protocol.start_s = start_s;
        StatusOr<UtiasCase> data = LoadUtiasCase(options.data, dataset, robot, protocol);
        if (data.ok()) {
          cases.push_back(*std::move(data));
        } else {
          missing = data.status();
        }
      }
    }
    if (cases.size() == before) return missing;
  }
  return cases;
}

}  // namespace

std::vector<IjrrUtiasMethod> IjrrUtiasMethods() {
  std::vector<IjrrUtiasMethod> methods;
  for (const Method& method : Methods()) methods.push_back(method.about);
  return methods;
}

Status IjrrUtiasOptions::Validate() const {
  if (datasets.empty() || robots.empty() || starts_s.empty() || deltas_m.empty()) {
    return InvalidArgument(
        "{} data sets, {} robots, {} starts, {} displacements, expected 1 or more of each",
        datasets.size(),
        robots.size(),
        starts_s.size(),
        deltas_m.size());
  }
  for (const double delta_m : deltas_m) {
    if (!std::isfinite(delta_m)) return InvalidArgument("displacement {} m", delta_m);
  }
  if (!(protocol.duration_s > 0.0 && protocol.prior_sd_m > 0.0)) {
    return InvalidArgument(
        "duration {} s, prior_sd_m {}, expected > 0", protocol.duration_s, protocol.prior_sd_m);
  }
  if (gate_probability && !(*gate_probability > 0.0 && *gate_probability < 1.0)) {
    return InvalidArgument("gate {}, expected within (0, 1)", *gate_probability);
  }
  if (realizations < 1 || threads < 1) {
    return InvalidArgument(
        "{} realizations, {} threads, expected 1 or more", realizations, threads);
  }
  SHIFTMAP_RETURN_IF_ERROR(SelectorOptions{.mcts = mcts}.Validate());
  const std::vector<IjrrUtiasMethod> known = IjrrUtiasMethods();
  for (const std::string& name : methods) {
    if (std::none_of(known.begin(), known.end(), [&](const IjrrUtiasMethod& method) {
          return method.name == name;
        })) {
      return InvalidArgument("method '{}': not one of this experiment", name);
    }
  }
  return OkStatus();
}

StatusOr<IjrrUtiasResult> RunIjrrUtias(
    const IjrrUtiasOptions& options,
    const std::function<void(const std::string& what, double done)>& progress) {
  SHIFTMAP_RETURN_IF_ERROR(options.Validate());
  IjrrUtiasResult result;
  SHIFTMAP_ASSIGN_OR_RETURN(result.cases, LoadCases(options));
  const auto trials = static_cast<double>(result.cases.size() * options.deltas_m.size());
  double done = 0.0;
  for (const UtiasCase& data : result.cases) {
    SHIFTMAP_ASSIGN_OR_RETURN(const MapperResult without_map, Build(data, std::nullopt));
    const UtiasNoise calibrated = CalibratedNoise(without_map);
    for (const double delta_m : options.deltas_m) {
      const Trial trial{
          &data, Displaced(data.landmarks, data.moved, delta_m), calibrated, &options};
      for (const Method& method : Methods()) {
        if (!Selected(options, method.about, delta_m)) continue;
        if (progress) {
          progress(fmt::format("set {} robot {} from {} s at {} m: {}",
                               data.dataset,
                               data.robot,
                               data.start_s,
                               delta_m,
                               method.about.name),
                   done / trials);
        }
        result.rows.push_back(RunMethod(method, trial, delta_m));
      }
      done += 1.0;
    }
  }
  return result;
}

}  // namespace shiftmap
