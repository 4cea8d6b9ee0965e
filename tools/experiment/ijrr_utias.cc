// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/ijrr_utias.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "mapper/mapper.h"
#include "tools/experiment/ijrr_utias_selectors.h"
#include "tools/experiment/ijrr_utias_static.h"

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

  Stamp begin() const { return data->run.odometry.front().stamp; }
};

StatusOr<MapperResult> Build(const UtiasCase& data, const std::optional<MapContent>& prior) {
  MapperInput input;
  input.name = fmt::format("set{}_robot{}", data.dataset, data.robot);
  input.sha256 = input.name;
  input.run = data.run;
  return BuildMap({std::move(input)}, prior, MapperOptions());
}

StatusOr<UtiasEstimate> RunMapper(const Trial& trial, const LandmarkPlaces& map) {
  const MapContent prior = SurveyMap(map, trial.options->protocol.prior_sd_m, trial.begin());
  SHIFTMAP_ASSIGN_OR_RETURN(const MapperResult result, Build(*trial.data, prior));
  if (result.runs.empty()) return InvalidArgument("run rejected");
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

// The options of IJRR 8.2.2, or of 8.2.4.
UtiasEstimate RunSelector(const Trial& trial, SelectorKind kind, const UtiasNoise& noise) {
  UtiasSelectorOptions options;
  options.selector.kind = kind;
  options.selector.seed = trial.options->seed;
  options.prior_sd_m = trial.options->protocol.prior_sd_m;
  options.max_range_m = trial.options->protocol.max_range_m;
  options.max_bearing_rad = trial.options->protocol.max_bearing_rad;
  if (trial.options->more_modes) {
    options.change_probability = 0.1;
    options.gate_probability = 0.8;
  }
  options.gate_probability = trial.options->gate_probability.value_or(options.gate_probability);
  return SolveWithSelector(*trial.data, noise, trial.map, options);
}

std::vector<Method> Methods() {
  std::vector<Method> methods = {
      {{"ours", true, false}, RunOurs},
      {{"oracle", true, false}, RunOracle},
      {{"static", true, false},
       [](const Trial& trial) { return RunStatic(trial, StaticLoss::kSquare); }},
      {{"static-cauchy", true, false},
       [](const Trial& trial) { return RunStatic(trial, StaticLoss::kCauchy); }}};
  for (const SelectorKind kind : {SelectorKind::kNearestNeighbor,
                                  SelectorKind::kEm,
                                  SelectorKind::kMcts,
                                  SelectorKind::kMaxMixture,
                                  SelectorKind::kViterbi}) {
    const std::string name = SelectorName(kind);
    const bool slow = kind == SelectorKind::kMcts;
    methods.push_back({{name + "-printed", false, slow}, [kind](const Trial& trial) {
                         return RunSelector(trial, kind, PrintedNoise(trial.data->dataset));
                       }});
    methods.push_back({{name, false, slow}, [kind](const Trial& trial) {
                         return RunSelector(trial, kind, trial.calibrated);
                       }});
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

IjrrUtiasRow RunMethod(const Method& method, const Trial& trial, double delta_m) {
  IjrrUtiasRow row;
  row.dataset = trial.data->dataset;
  row.robot = trial.data->robot;
  row.delta_m = delta_m;
  row.method = method.about.name;
  row.frames = static_cast<int>(trial.data->frames.frames.size());
  const auto begin = std::chrono::steady_clock::now();
  StatusOr<UtiasEstimate> estimate = method.run(trial);
  row.wall_s = ToSeconds(std::chrono::steady_clock::now() - begin);
  row.pose_rmse_m = row.landmark_rmse_m = std::numeric_limits<double>::quiet_NaN();
  if (!estimate.ok()) return row;
  const UtiasScore score = ScoreUtias(*trial.data, *estimate);
  row.pose_rmse_m = score.pose_rmse_m;
  row.landmark_rmse_m = score.landmark_rmse_m;
  row.modes = score.modes;
  row.created = estimate->created;
  row.estimate = *std::move(estimate);
  return row;
}

StatusOr<std::vector<UtiasCase>> LoadCases(const IjrrUtiasOptions& options) {
  std::vector<UtiasCase> cases;
  for (const int dataset : options.datasets) {
    for (const int robot : options.robots) {
      StatusOr<UtiasCase> data = LoadUtiasCase(options.data, dataset, robot, options.protocol);
      if (data.status().code() == StatusCode::kNotFound) continue;
      SHIFTMAP_RETURN_IF_ERROR(data.status());
      cases.push_back(*std::move(data));
    }
  }
  if (cases.empty()) {
    return NotFound("folder '{}': none of the data sets with any of the robots", options.data);
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
  if (datasets.empty() || robots.empty() || deltas_m.empty()) {
    return InvalidArgument("{} data sets, {} robots, {} displacements, expected 1 or more of each",
                           datasets.size(),
                           robots.size(),
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
          progress(fmt::format("set {} robot {} at {} m: {}",
                               data.dataset,
                               data.robot,
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
