// SPDX-License-Identifier: Apache-2.0
#include "mapper/mapper.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <mutex>
#include <tuple>
#include <utility>

#include "mapper/association/track_names.h"
#include "mapper/calibration/detection.h"
#include "mapper/calibration/implausible_calibration.h"
#include "mapper/calibration/noise_calibration.h"
#include "mapper/calibration/vehicle_update.h"
#include "mapper/covariance/map_prior.h"
#include "mapper/covariance/mode_covariance.h"
#include "mapper/map_output.h"
#include "mapper/memory_estimate.h"
#include "mapper/modes/loose_runs.h"
#include "mapper/modes/mode_merging.h"
#include "mapper/modes/mode_refinement.h"
#include "mapper/parallel.h"
#include "mapper/problem/map_problem.h"
#include "mapper/submaps/place_submaps.h"
#include "mapper/submaps/single_run.h"
#include "mapper/submaps/stray_runs.h"
#include "mapper/submaps/submap.h"

namespace shiftmap {
namespace {

// Puts the start of the earliest run at the origin of the map.
void AnchorFrame(MapProblem* problem) {
  MoveProblem(StartPose(problem->runs.front()).Inverse(), problem);
}

// What the runs by themselves say of the sensor, as the start of the common estimate.
SensorCalibration RmsSensor(const std::vector<Submap>& submaps, const SensorCalibration& fallback) {
  if (submaps.empty()) return fallback;
  SensorCalibration mean = fallback;
  const auto average = [&](double SensorCalibration::*member) {
    double sum = 0.0;
    for (const Submap& submap : submaps) sum += std::pow(submap.problem.sensor.*member, 2);
    mean.*member = std::sqrt(sum / static_cast<double>(submaps.size()));
  };
  average(&SensorCalibration::sd_range_m);
  average(&SensorCalibration::sd_bearing_rad);
  average(&SensorCalibration::sd_position_m);
  return mean;
}

std::vector<MappingRun> PrepareRuns(const std::vector<MapperInput>& inputs,
                                    const std::vector<Signature>& signatures,
                                    const MapperOptions& options,
                                    std::vector<RejectedRun>* rejected) {
  std::vector<MappingRun> runs;
  for (const MapperInput& input : inputs) {
    MappingRun run = MakeMappingRun(input.run, signatures, options.front_end);
    run.name = input.name;
    run.sha256 = input.sha256;
    if (run.sightings.empty()) {
      rejected->push_back({input.name, "no identified landmark is seen"});
    } else {
      runs.push_back(std::move(run));
    }
  }
  return runs;
}

Status RequireRuns(bool any, const std::vector<RejectedRun>& rejected) {
  if (any) return OkStatus();
  if (rejected.empty()) return InvalidArgument("no runs to build from");
  return InvalidArgument(
      "no run can be used; first: run '{}': {}", rejected.front().name, rejected.front().reason);
}

// Tells the monitor of a build how it goes on, one thread at a time, and remembers that it asked to
// stop.
class Watch {
 public:
  explicit Watch(const MapperMonitor& monitor) : monitor_(monitor) {}

  // Returns whether to go on.
  bool Report(const std::string& phase, double done, const MapProblem& problem) {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (!monitor_ || stopped_) return !stopped_;
    std::size_t modes = 0;
    for (const std::vector<BuildMode>& group : problem.modes) modes += group.size();
    done_ = std::max(done_, done);  // Threads take runs in turn, not their reports.
    stopped_ = !monitor_({phase, done_, problem.cost, modes});
    return !stopped_;
  }

  GoOn During(std::string phase, double done) {
    return [this, phase = std::move(phase), done](const MapProblem& problem) {
      return Report(phase, done, problem);
    };
  }

  Status status() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return stopped_ ? MakeStatus(StatusCode::kCancelled, "build: stopped") : OkStatus();
  }

 private:
  const MapperMonitor& monitor_;
  mutable std::mutex mutex_;
  double done_ = 0.0;
  bool stopped_ = false;
};

// Runs by themselves take about half of a build, each the same share.
constexpr double kSingleRunsShare = 0.5;

// Landmarks without signature get the names of their tracks.
Status NameAnonymous(const MapperOptions& options, Watch* watch, std::vector<MapperInput>* inputs) {
  if (!options.association.associate) return OkStatus();
  std::vector<Status> named(inputs->size());
  ForEachIndex(inputs->size(), options.threads, [&](std::size_t i) {
    MapperInput& input = (*inputs)[i];
    const std::string phase = fmt::format("landmarks without signature, run {}", input.name);
    named[i] = NameTracks(
        static_cast<int>(i),
        options.calibration,
        options.association,
        options.front_end,
        [&] { return watch->Report(phase, 0.0, {}); },
        &input.run);
  });
  SHIFTMAP_RETURN_IF_ERROR(watch->status());
  for (std::size_t i = 0; i < inputs->size(); ++i) {
    if (named[i].ok()) continue;
    return Annotate(named[i], "run '{}'", (*inputs)[i].name);
  }
  return OkStatus();
}

StatusOr<std::vector<Submap>> MapRunsSingly(const std::vector<MappingRun>& runs,
                                            std::size_t groups,
                                            const MapperOptions& options,
                                            Watch* watch,
                                            std::vector<RejectedRun>* rejected) {
  MapperOptions alone = options;  // Threads that runs leave go to what is inside each.
  alone.threads = std::max(1, options.threads / std::max(1, static_cast<int>(runs.size())));
  std::vector<MapProblem> problems(runs.size());
  ForEachIndex(runs.size(), options.threads, [&](std::size_t i) {
    const double done =
        kSingleRunsShare * static_cast<double>(i) / static_cast<double>(runs.size());
    const GoOn go_on = watch->During(fmt::format("run {}", runs[i].name), done);
    if (!go_on({})) return;
    problems[i] = MapSingleRun(runs[i], groups, alone, go_on);
  });
  SHIFTMAP_RETURN_IF_ERROR(watch->status());
  std::erase_if(problems, [&](const MapProblem& problem) {
    const BuildRun& run = problem.runs.front();
    const std::string implausible = ImplausibleCalibration(run);
    if (!implausible.empty()) rejected->push_back({run.data->name, implausible});
    return !implausible.empty();
  });
  RaiseNoiseByVehicle(&problems);
  std::vector<std::string> names;
  for (const MapProblem& problem : problems) names.push_back(problem.runs.front().data->name);
  std::vector<std::optional<Submap>> made(problems.size());
  ForEachIndex(problems.size(), options.threads, [&](std::size_t i) {
    made[i] = MakeSubmap(alone, std::move(problems[i]));
  });
  std::vector<Submap> submaps;
  for (std::size_t i = 0; i < made.size(); ++i) {
    if (made[i]) {
      submaps.push_back(*std::move(made[i]));
    } else {
      rejected->push_back({names[i], kUndeterminedReason});
    }
  }
  return submaps;
}

BuildSize SizeOf(const std::vector<MapperInput>& inputs,
                 const std::optional<MapContent>& prior,
                 const MapperOptions& options) {
  BuildSize size;
  size.runs_at_once = std::min<std::int64_t>(options.threads, std::ssize(inputs));
  if (prior) size.prior_modes = prior->covariance.size();
  for (const MapperInput& input : inputs) AddRun(input.run, &size);
  return size;
}

Status RequireTiedRuns(const MapProblem& problem) {
  if (!problem.runs.empty()) return OkStatus();
  return RequireRuns(false, problem.left_out);
}

// Once runs are placed, what is so many standard deviations from its mode is an outlier.
constexpr double kLossReach = 50.0;

// A run that is put back may be what another one is to be held against.
constexpr int kStrayRounds = 3;

// What is discrete in all runs together, where every run is where the others say.
int RefineAndPutBack(const MapperOptions& options,
                     const GoOn& go_on,
                     MapProblem* problem,
                     GraphSolver* solver) {
  const auto refine = [&] {
    return options.calibrate ? AlternateModes(options, problem, solver, go_on)
                             : RefineModes(options, problem, solver, go_on);
  };
  int iterations = refine();
  for (int round = 0; round < kStrayRounds && PutBackStrayRuns(options, problem, go_on) > 0;
       ++round) {
    iterations += refine();
  }
  return iterations;
}

// Takes out modes of too few sightings, and runs that nothing holds then.
Status TakeOutFaint(const MapperOptions& options, MapProblem* problem) {
  if (DropFaintModes(options.modes, problem) == 0) return OkStatus();
  if (FlatModes(*problem).count == 0) {
    return InvalidArgument("no run can be used: none has {} sightings of one landmark",
                           options.modes.min_sightings);
  }
  TakeOutLooseRuns(problem);
  SHIFTMAP_RETURN_IF_ERROR(RequireTiedRuns(*problem));
  if (!options.calibrate) SolveContinuous(options, problem);  // Else with the noise.
  return OkStatus();
}

// What is discrete in all runs together, and the noise. Returns the outer iterations.
StatusOr<int> RefineTogether(const MapperOptions& options, Watch* watch, MapProblem* problem) {
  problem->loss_reach = kLossReach;
  GraphSolver solver;  // Rounds of noise go on from where this ends.
  int iterations = RefineAndPutBack(options, watch->During("all runs", 0.6), problem, &solver);
  SHIFTMAP_RETURN_IF_ERROR(watch->status());
  SHIFTMAP_RETURN_IF_ERROR(RequireTiedRuns(*problem));
  SHIFTMAP_RETURN_IF_ERROR(TakeOutFaint(options, problem));
  if (!options.calibrate) return iterations;
  problem->sensor = EstimateDetection(*problem, options.modes);
  CalibrateNoise(options, {}, problem, &solver, watch->During("noise", 0.7));
  SHIFTMAP_RETURN_IF_ERROR(watch->status());
  iterations += RefineModes(options, problem, &solver, watch->During("all runs", 0.8));
  SHIFTMAP_RETURN_IF_ERROR(watch->status());
  SHIFTMAP_RETURN_IF_ERROR(RequireTiedRuns(*problem));
  return iterations;
}

std::vector<Signature> AllSignatures(const std::vector<MapperInput>& inputs,
                                     const std::optional<MapContent>& prior) {
  std::vector<Signature> known;
  if (prior) {
    for (const LandmarkGroup& group : prior->groups) known.push_back(group.signature);
  }
  std::vector<const Run*> runs;
  for (const MapperInput& input : inputs) runs.push_back(&input.run);
  return CollectSignatures(runs, known);
}

// Runs mapped one by one and placed in one frame, by begin.
StatusOr<MapProblem> PlaceRuns(const std::vector<MappingRun>& runs,
                               const std::vector<Signature>& signatures,
                               const std::optional<MapContent>& prior,
                               const MapperOptions& options,
                               Watch* watch,
                               std::vector<RejectedRun>* rejected) {
  SHIFTMAP_ASSIGN_OR_RETURN(std::vector<Submap> submaps,
                            MapRunsSingly(runs, signatures.size(), options, watch, rejected));
  std::optional<MapContent> known = prior;
  const double sd_scale = known ? TakeOutScale(options.sd_range_scale, &*known) : 0.0;
  const SensorCalibration sensor = RmsSensor(submaps, options.calibration.sensor);
  MapProblem problem =
      known ? StartProblem(signatures, *known, sensor) : StartProblem(signatures.size(), sensor);
  problem.sd_scale = sd_scale;
  PlaceSubmaps(options,
               known,
               std::move(submaps),
               &problem,
               rejected,
               watch->During("placing runs", kSingleRunsShare));
  SHIFTMAP_RETURN_IF_ERROR(watch->status());
  if (problem.runs.empty() && !problem.waiting.empty()) return problem;
  SHIFTMAP_RETURN_IF_ERROR(RequireRuns(!problem.runs.empty(), *rejected));
  std::stable_sort(
      problem.runs.begin(), problem.runs.end(), [](const BuildRun& a, const BuildRun& b) {
        return std::tie(a.data->odometry.front().stamp, a.data->sha256) <
               std::tie(b.data->odometry.front().stamp, b.data->sha256);
      });
  if (!prior) AnchorFrame(&problem);
  if (options.calibrate) PoolNoiseByVehicle(&problem);
  return problem;
}

// Runs of a build without a prior map do not tell their scales, and those of one vehicle share one.
// A prior map that knows its scale better than sensors do lost nothing of it (TakeOutScale).
ScaleUncertainty ScaleOf(const MapperOptions& options, const MapProblem& problem) {
  ScaleUncertainty scale{std::max(options.sd_range_scale, problem.sd_scale),
                         options.sd_run_range_scale};
  if (problem.in_map_units) {
    if (problem.sd_scale == 0.0) scale.sd_common = 0.0;
    return scale;
  }
  const auto runs = RunsByVehicle(problem);
  if (runs.size() < 2) return scale;
  for (const auto& [vehicle, of_vehicle] : runs) scale.runs_of_vehicles.push_back(of_vehicle);
  return scale;
}

// The solved problem as *graph, and that about its solution, for as long as *graph stays where it
// is. A log of values beyond all bounds costs its run, not the others' night.
StatusOr<std::unique_ptr<GraphPosterior>> Linearize(const MapperOptions& options,
                                                    MapProblem* problem,
                                                    Graph* graph) {
  *graph = MakeGraph(options, problem);
  std::unique_ptr<GraphPosterior> posterior = LinearizeForMap(*graph);
  if (!posterior && TakeOutUndeterminedRuns(options, problem) > 0) {
    TakeOutLooseRuns(problem);
    SHIFTMAP_RETURN_IF_ERROR(RequireTiedRuns(*problem));
    SolveContinuous(options, problem);
    if (problem->priors.empty()) AnchorFrame(problem);
    *graph = MakeGraph(options, problem);
    posterior = LinearizeForMap(*graph);
  }
  if (!posterior) return InvalidArgument("the runs do not determine where their landmarks are");
  return posterior;
}

// What was to be expected before the runs were placed may be less than the modes that they brought:
// the runs that brought most are left out until the others fit.
Status FitModes(const MapperOptions& options, BuildSize* size, MapProblem* problem) {
  for (;;) {
    size->modes = FlatModes(*problem).count;
    const Status fits = CheckBuildMemory(*size, options.max_memory_bytes);
    if (fits.ok() || !TakeOutRunWithMostModes(problem)) return fits;
    TakeOutLooseRuns(problem);
    SHIFTMAP_RETURN_IF_ERROR(RequireTiedRuns(*problem));
    if (problem->priors.empty()) AnchorFrame(problem);
  }
}

bool IsAheadOfClock(const MapContent& prior, const MapperOptions& options) {
  return options.now &&
         !CheckNotInFuture("prior", prior.stamp, *options.now, options.clock_tolerance_s).ok();
}

// A map as it was when the earliest run began.
MapContent AsOfRuns(MapContent map,
                    const std::vector<MapperInput>& inputs,
                    const MapperOptions& options) {
  map.stamp = *options.now;
  for (const MapperInput& input : inputs) {
    map.stamp = std::min(map.stamp, input.run.odometry.front().stamp);
  }
  for (LandmarkGroup& group : map.groups) {
    for (Mode& mode : group.modes) mode.last_seen = std::min(mode.last_seen, map.stamp);
  }
  for (Mode& mode : map.anonymous_landmarks) {
    mode.last_seen = std::min(mode.last_seen, map.stamp);
  }
  for (VehicleCalibration& vehicle : map.vehicles) {
    vehicle.stamp = std::min(vehicle.stamp, map.stamp);
  }
  return map;
}

std::vector<Signature> Named(const std::vector<Signature>& signatures,
                             const std::vector<int>& groups) {
  std::vector<Signature> named;
  for (const int group : groups) named.push_back(signatures[static_cast<std::size_t>(group)]);
  return named;
}

AmbiguousChange Describe(const WaitingRuns& waiting, const std::vector<Signature>& signatures) {
  constexpr double kUnlikely = 0.01;
  AmbiguousChange change;
  for (const WaitingRuns::Run& run : waiting.runs) change.runs.push_back({run.name, run.sha256});
  change.deciding = Named(signatures, waiting.explanations.deciding);
  for (const Explanation& explanation : waiting.explanations.frames) {
    if (explanation.probability < kUnlikely && change.explanations.size() > 1) break;
    change.explanations.push_back({Named(signatures, explanation.alignment.signatures),
                                   Named(signatures, explanation.moved),
                                   explanation.probability});
  }
  return change;
}

// What is told of a solved problem.
Status Conclude(const std::vector<Signature>& signatures,
                const std::optional<MapContent>& prior,
                const MapperOptions& options,
                MapProblem* problem,
                MapperResult* result) {
  Graph graph;
  SHIFTMAP_ASSIGN_OR_RETURN(const std::unique_ptr<GraphPosterior> posterior,
                            Linearize(options, problem, &graph));
  const JointCovariance covariance = MapCovariance(graph, *posterior, ScaleOf(options, *problem));
  SHIFTMAP_ASSIGN_OR_RETURN(MapOutput output,
                            MakeMapContent(*problem, signatures, prior, covariance, options));
  result->content = std::move(output.content);
  result->chains = std::move(output.chains);
  result->older = std::move(output.older);
  if (options.calibrate) {
    result->vehicles = CalibrateVehicles(options, graph, *posterior, *problem);
  }
  if (prior) result->content.vehicles = prior->vehicles;
  UpdateVehicles(result->vehicles, &result->content.vehicles);
  SHIFTMAP_RETURN_IF_ERROR(ValidateMapContent(result->content));
  for (std::size_t i = 0; i < problem->runs.size(); ++i) {
    result->runs.push_back(MakeMappedRun(*problem, i));
    result->runs.back().evidence = std::move(output.evidence[i]);
    result->runs.back().visibility = std::move(output.visibility[i]);
  }
  for (const std::vector<BuildMode>& group : problem->modes) {
    for (const BuildMode& mode : group) result->modes_created += mode.number == kAbsent;
  }
  result->modes_merged = problem->modes_merged;
  result->selection = SummarizeSelection(options.modes, *problem);
  return OkStatus();
}

}  // namespace

StatusOr<MapperResult> BuildMap(std::vector<MapperInput> inputs,
                                const std::optional<MapContent>& prior,
                                const MapperOptions& options,
                                const MapperMonitor& monitor) {
  SHIFTMAP_RETURN_IF_ERROR(CheckInputs(inputs, prior, options));
  if (prior && IsAheadOfClock(*prior, options)) {
    const MapContent known = AsOfRuns(*prior, inputs, options);
    return BuildMap(std::move(inputs), known, options, monitor);
  }
  BuildSize size = SizeOf(inputs, prior, options);
  SHIFTMAP_RETURN_IF_ERROR(CheckBuildMemory(size, options.max_memory_bytes));
  MapperResult result;
  result.estimated_memory_bytes = EstimateBuildMemory(size);
  SortByBegin(&inputs);
  Watch watch(monitor);
  SHIFTMAP_RETURN_IF_ERROR(NameAnonymous(options, &watch, &inputs));
  const std::vector<Signature> signatures = AllSignatures(inputs, prior);
  const std::vector<MappingRun> runs = PrepareRuns(inputs, signatures, options, &result.rejected);
  SHIFTMAP_RETURN_IF_ERROR(RequireRuns(!runs.empty(), result.rejected));

  SHIFTMAP_ASSIGN_OR_RETURN(MapProblem problem,
                            PlaceRuns(runs, signatures, prior, options, &watch, &result.rejected));
  for (const WaitingRuns& waiting : problem.waiting) {
    result.ambiguous_changes.push_back(Describe(waiting, signatures));
  }
  if (problem.runs.empty()) {  // Without a prior map one run at least is in the map.
    result.content = prior.value();
    return result;
  }
  SHIFTMAP_RETURN_IF_ERROR(FitModes(options, &size, &problem));

  SHIFTMAP_ASSIGN_OR_RETURN(result.outer_iterations, RefineTogether(options, &watch, &problem));
  if (!prior) AnchorFrame(&problem);
  watch.Report("covariance", 0.9, problem);
  SHIFTMAP_RETURN_IF_ERROR(watch.status());
  SHIFTMAP_RETURN_IF_ERROR(Conclude(signatures, prior, options, &problem, &result));
  result.rejected.insert(result.rejected.end(), problem.left_out.begin(), problem.left_out.end());
  watch.Report("done", 1.0, problem);
  SHIFTMAP_RETURN_IF_ERROR(watch.status());
  return result;
}

}  // namespace shiftmap
