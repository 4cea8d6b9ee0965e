// SPDX-License-Identifier: Apache-2.0
#include "mapper/mapper.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <memory>
#include <mutex>
#include <tuple>
#include <utility>

#include "mapper/association/track_names.h"
#include "mapper/calibration/detection.h"
#include "mapper/calibration/distortion_calibration.h"
#include "mapper/calibration/implausible_calibration.h"
#include "mapper/calibration/noise_calibration.h"
#include "mapper/calibration/vehicle_update.h"
#include "mapper/covariance/map_prior.h"
#include "mapper/covariance/mode_covariance.h"
#include "mapper/map_output.h"
#include "mapper/memory_estimate.h"
#include "mapper/modes/doubtful_modes.h"
#include "mapper/modes/mode_merging.h"
#include "mapper/modes/mode_refinement.h"
#include "mapper/modes/unconstrained_runs.h"
#include "mapper/parallel.h"
#include "mapper/registration/ambiguous_runs.h"
#include "mapper/registration/misfit_runs.h"
#include "mapper/registration/misregistered_runs.h"
#include "mapper/registration/place_run_maps.h"
#include "mapper/run_maps/run_map.h"
#include "mapper/run_maps/run_variances.h"
#include "mapper/run_maps/single_run.h"
#include "mapper/run_maps/unconfirmed_visits.h"
#include "mapper/state/build_state.h"
#include "mapper/state/sightings.h"

namespace shiftmap {
namespace {

using GroupSignatures = IndexedVector<GroupIndex, Signature>;

// Puts the start of the earliest run at the origin of the map.
void AnchorFrame(BuildState* build) { MoveBuild(StartPose(build->runs.front()).Inverse(), build); }

// What the runs by themselves say of the sensor, as the start of the common estimate.
SensorCalibration RmsSensor(const std::vector<RunMap>& run_maps,
                            const SensorCalibration& fallback) {
  if (run_maps.empty()) return fallback;
  SensorCalibration mean = fallback;
  const auto average = [&](double SensorCalibration::*member) {
    double sum = 0.0;
    for (const RunMap& run_map : run_maps) sum += std::pow(run_map.build.sensor.*member, 2);
    mean.*member = std::sqrt(sum / static_cast<double>(run_maps.size()));
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
      std::string reason = "no identified landmark is seen";
      if (run.anonymous_observations > 0) {
        reason += fmt::format(
            ", {} observations have no signature{}",
            run.anonymous_observations,
            options.association.associate ? ", and too few of them can be associated" : "");
      }
      rejected->push_back({input.name, std::move(reason)});
    } else {
      runs.push_back(std::move(run));
    }
  }
  return runs;
}

Status RequireRuns(bool any, const std::vector<RejectedRun>& rejected) {
  if (any) return OkStatus();
  if (rejected.empty()) return InvalidArgument("no runs to build from");
  return InvalidArgument("no run can be used: {}", ReasonsOf(rejected));
}

// Tells the monitor of a build how it goes on, one thread at a time, and remembers that it asked to
// stop.
class Watch {
 public:
  explicit Watch(const MapperMonitor& monitor) : monitor_(monitor) {}

  // Returns whether to go on.
  bool Report(const std::string& phase, double done, const BuildState& build) {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (!monitor_ || stopped_) return !stopped_;
    std::size_t modes = 0;
    for (const GroupModes& group : build.modes) modes += group.size();
    done_ = std::max(done_, done);  // Threads take runs in turn, not their reports.
    stopped_ = !monitor_({phase, done_, build.cost, modes});
    return !stopped_;
  }

  StepCallback During(std::string phase, double done) {
    return [this, phase = std::move(phase), done](const BuildState& build) {
      return Report(phase, done, build);
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

// Why a run that is mapped by itself is not used; empty if it is.
std::string ReasonAgainst(const MapperOptions& options, const BuildState& build) {
  const BuildRun& run = build.runs.front();
  std::string reason = ImplausibleCalibration(options.plausibility, run, build.sensor);
  if (!reason.empty()) return reason;
  if (ModesOf(run).empty()) return kOutliersReason;
  std::ptrdiff_t outliers = 0;  // A single sighting agrees with nothing by chance.
  for (const VisitIndex v : run.data->visits.indices()) {
    const MappingVisit& visit = run.data->visits[v];
    if (!MakesMode(options.modes, visit)) continue;
    outliers += std::ssize(visit.sightings) - CountInliers(build, {RunIndex(0), v});
  }
  const auto all = static_cast<double>(run.data->sightings.size());
  if (static_cast<double>(outliers) <= options.plausibility.max_outliers * all) return "";
  return fmt::format("{} of {} observations do not agree with the others: signatures are misread",
                     outliers,
                     run.data->sightings.size());
}

StatusOr<std::vector<RunMap>> MapRunsSingly(const std::vector<MappingRun>& runs,
                                            std::size_t groups,
                                            const MapperOptions& options,
                                            Watch* watch,
                                            std::vector<RejectedRun>* rejected) {
  MapperOptions alone = options;  // Threads that runs leave go to what is inside each.
  alone.threads = std::max(1, options.threads / std::max(1, static_cast<int>(runs.size())));
  std::vector<BuildState> builds(runs.size());
  ForEachIndex(runs.size(), options.threads, [&](std::size_t i) {
    const double done =
        kSingleRunsShare * static_cast<double>(i) / static_cast<double>(runs.size());
    const StepCallback on_step = watch->During(fmt::format("run {}", runs[i].name), done);
    if (!on_step({})) return;
    builds[i] = MapSingleRun(runs[i], groups, alone, on_step);
  });
  SHIFTMAP_RETURN_IF_ERROR(watch->status());
  std::erase_if(builds, [&](const BuildState& build) {
    std::string reason = ReasonAgainst(options, build);
    if (reason.empty()) return false;
    rejected->push_back({build.runs.front().data->name, std::move(reason)});
    return true;
  });
  RaiseNoiseByVehicle(&builds);
  std::vector<std::string> names;
  for (const BuildState& build : builds) names.push_back(build.runs.front().data->name);
  std::vector<std::optional<RunMap>> made(builds.size());
  ForEachIndex(builds.size(), options.threads, [&](std::size_t i) {
    made[i] = MakeUndistortedRunMap(alone, std::move(builds[i]));
  });
  std::vector<RunMap> run_maps;
  for (std::size_t i = 0; i < made.size(); ++i) {
    if (made[i]) {
      run_maps.push_back(*std::move(made[i]));
    } else {
      rejected->push_back({names[i], kUndeterminedReason});
    }
  }
  return run_maps;
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

// Of the runs that are left some may have lost all that tied them to a map. It is an error if none
// is left then and none waits.
Status RemoveRunsOfNoMode(BuildState* build) {
  RemoveRunsOfOutliers(build);
  return RequireRuns(!build->runs.empty() || !build->waiting.empty(), build->left_out);
}

// Takes out what others that were taken out leave untied.
Status RemoveUntiedRuns(BuildState* build) {
  if (!build->runs.empty()) RemoveUnconstrainedRuns(build);
  return RemoveRunsOfNoMode(build);
}

// A run that is put back may be what another one is to be held against.
constexpr int kRelocationRounds = 3;

// Poses runs without the modes that were displaced from one of several places of the prior map. A
// run by itself may have one mode of a door, between its places, and poses that fit it: its visits
// are not told apart from there. A run that mostly has such modes, or few of the prior map beside
// them, would come apart, and stays.
void PoseByOthers(const MapperOptions& options, BuildState* build) {
  const auto may_be_between = [&](const BuildModeRef& ref) {
    const LandmarkGroup* const known = build->Known(ref.group);
    return build->modes[ref.group][ref.mode].displaced_to && known && known->modes.size() > 1;
  };
  std::vector<RunIndex> runs;
  for (const RunIndex r : build->runs.indices()) {
    const std::vector<BuildModeRef> modes = ModesOf(build->runs[r]);
    const auto between = std::count_if(modes.begin(), modes.end(), may_be_between);
    const auto of_prior = std::count_if(modes.begin(), modes.end(), [&](const BuildModeRef& ref) {
      return build->modes[ref.group][ref.mode].number != kAbsent;
    });
    if (between > 0 && 2 * between <= std::ssize(modes) && of_prior >= kMinTyingModes) {
      runs.push_back(r);
    }
  }
  if (runs.empty()) return;
  BuildState without = *build;
  for (const RunIndex r : runs) {
    BuildRun& run = without.runs[r];
    for (const VisitIndex v : run.assignment.indices()) {
      OptionalMode& mode = run.assignment[v];
      if (mode && may_be_between({run.data->visits[v].group, *mode})) mode = kUnassigned;
    }
  }
  DropUnusedModes(&without);
  SolveContinuous(options, &without);
  for (const RunIndex r : runs) build->runs[r].poses = std::move(without.runs[r].poses);
}

// Selects modes over all runs, relocates misregistered runs, and removes runs that are ambiguous or
// do not fit.
int RefineAndRelocate(const MapperOptions& options,
                      const StepCallback& on_step,
                      BuildState* build,
                      GraphSolver* solver) {
  const auto refine = [&] {
    return options.calibrate ? AlternateModes(options, build, solver, on_step)
                             : RefineModes(options, build, solver, on_step);
  };
  int iterations = refine();
  for (int round = 0;
       round < kRelocationRounds && RelocateMisregisteredRuns(options, build, on_step) > 0;
       ++round) {
    iterations += refine();
  }
  while ((RemoveAmbiguousRun(options, build, on_step) || RemoveMisfitRun(options, build)) &&
         !build->runs.empty() && (!on_step || on_step(*build))) {
    iterations += refine();
  }
  return iterations;
}

// The same with the noise as it is calibrated; it is asked again which runs are ambiguous where
// that changes the mode of a visit.
int RefineWithNoise(const MapperOptions& options,
                    const StepCallback& on_step,
                    BuildState* build,
                    GraphSolver* solver) {
  const auto assignments = [&] {
    std::vector<IndexedVector<VisitIndex, OptionalMode>> of_runs;
    for (const BuildRun& run : build->runs) of_runs.push_back(run.assignment);
    return of_runs;
  };
  const auto before = assignments();
  int iterations = RefineModes(options, build, solver, on_step);
  if (assignments() == before) return iterations;
  while (RemoveAmbiguousRun(options, build, on_step) && !build->runs.empty() &&
         (!on_step || on_step(*build))) {
    iterations += RefineModes(options, build, solver, on_step);
  }
  return iterations;
}

// Takes out modes of too few sightings, and runs that nothing holds then.
Status RemoveUnsupported(const MapperOptions& options, BuildState* build) {
  if (build->runs.empty() || DropUnsupportedModes(options.modes, build) == 0) return OkStatus();
  if (FlatModes(*build).count() == 0) {
    return InvalidArgument("no run can be used: none has {} sightings of one landmark",
                           options.modes.min_sightings);
  }
  SHIFTMAP_RETURN_IF_ERROR(RemoveUntiedRuns(build));
  if (!options.calibrate && !build->runs.empty()) {
    SolveContinuous(options, build);  // Else with the noise.
  }
  return OkStatus();
}

// Of the last solve: both solvers are to make the same map, also where it is known badly. [-]
constexpr double kMapCostTolerance = 1e-6;

// Refines modes, noise and run variances of all runs jointly. Returns the outer iterations. Leaves
// no run where the last ones wait.
StatusOr<int> RefineTogether(const MapperOptions& options, Watch* watch, BuildState* build) {
  build->loss_reach = options.loss_reach_sds;
  PoseByOthers(options, build);
  ConfirmVisits(options, build);
  GraphSolver solver;  // Rounds of noise go on from where this ends.
  int iterations = RefineAndRelocate(options, watch->During("all runs", 0.6), build, &solver);
  SHIFTMAP_RETURN_IF_ERROR(watch->status());
  SHIFTMAP_RETURN_IF_ERROR(RemoveRunsOfNoMode(build));
  SHIFTMAP_RETURN_IF_ERROR(RemoveUnsupported(options, build));
  if (build->runs.empty()) return iterations;
  if (options.calibrate) {
    DropDistortions(build);
    SolveContinuous(options, build, &solver);
    build->sensor = EstimateDetection(*build, options.modes);
    CalibrateNoise(options, {}, build, &solver, watch->During("noise", 0.7));
    SHIFTMAP_RETURN_IF_ERROR(watch->status());
    const std::size_t runs = build->runs.size();
    iterations += RefineWithNoise(options, watch->During("all runs", 0.8), build, &solver);
    SHIFTMAP_RETURN_IF_ERROR(watch->status());
    SHIFTMAP_RETURN_IF_ERROR(RemoveRunsOfNoMode(build));
    if (build->runs.empty()) return iterations;
    if (build->runs.size() < runs) {
      SHIFTMAP_RETURN_IF_ERROR(RemoveUnsupported(options, build));
      if (build->runs.empty()) return iterations;
      SolveContinuous(options, build, &solver);
    }
  }
  if (RemoveImplausibleRuns(options.plausibility, build) > 0) {
    SHIFTMAP_RETURN_IF_ERROR(RemoveUntiedRuns(build));
    if (build->runs.empty()) return iterations;
    SolveContinuous(options, build);
  }
  EstimateRunVariances(options, build);
  MapperOptions precise = options;
  precise.solver.cost_tolerance = std::min(kMapCostTolerance, options.solver.cost_tolerance);
  SolveWithDistortions(precise, build, &solver);
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
StatusOr<BuildState> PlaceRuns(const std::vector<MappingRun>& runs,
                               const std::vector<Signature>& signatures,
                               const std::optional<MapContent>& prior,
                               const MapperOptions& options,
                               Watch* watch,
                               std::vector<RejectedRun>* rejected) {
  SHIFTMAP_ASSIGN_OR_RETURN(std::vector<RunMap> run_maps,
                            MapRunsSingly(runs, signatures.size(), options, watch, rejected));
  std::optional<MapContent> known = prior;
  const double sd_scale = known ? RemoveScale(options.sd_range_scale, &*known) : 0.0;
  const SensorCalibration sensor = RmsSensor(run_maps, options.calibration.sensor);
  BuildState build =
      known ? StartBuild(signatures, *known, sensor) : StartBuild(signatures.size(), sensor);
  build.sd_scale = sd_scale;
  PlaceRunMaps(options,
               known,
               std::move(run_maps),
               &build,
               rejected,
               watch->During("placing runs", kSingleRunsShare));
  SHIFTMAP_RETURN_IF_ERROR(watch->status());
  SHIFTMAP_RETURN_IF_ERROR(RequireRuns(!build.runs.empty() || !build.waiting.empty(), *rejected));
  if (build.runs.empty()) return build;
  std::stable_sort(build.runs.begin(), build.runs.end(), [](const BuildRun& a, const BuildRun& b) {
    return std::tie(a.data->begin, a.data->sha256) < std::tie(b.data->begin, b.data->sha256);
  });
  if (!prior) AnchorFrame(&build);
  if (options.calibrate) PoolNoiseByVehicle(&build);
  return build;
}

// Standard deviation of the scale that no run estimates. RemoveScale() took nothing out of a prior
// map that knows its scale better than sensors do. Without a prior map the scale is the mean over
// all runs, and the runs of a vehicle share one: its variance is that of a vehicle's scale times
// the sum of the squared shares of the vehicles. If the graph estimates the scales, it has the
// variance over the number of runs already, as it takes those of runs to be independent.
double ScaleSd(const MapperOptions& options, const BuildState& build) {
  if (build.in_map_units && build.sd_scale == 0.0) return 0.0;
  double of_mean = 0.0;
  if (!build.in_map_units) {
    const auto runs = static_cast<double>(build.runs.size());
    for (const auto& [vehicle, of_vehicle] : RunsByVehicle(build)) {
      const double share = static_cast<double>(of_vehicle.size()) / runs;
      of_mean += share * share;
    }
    if (options.calibrate && TellsScales(build)) of_mean -= 1.0 / runs;
  }
  return std::hypot(std::max(options.sd_range_scale, build.sd_scale),
                    options.sd_run_range_scale * std::sqrt(std::max(0.0, of_mean)));
}

// What is known about the solution of a build.
struct SolvedGraph {
  Graph graph;
  std::unique_ptr<GraphPosterior> posterior;  // Of the graph; null if it is not determined.
  JointCovariance covariance;
};

// @param solved  Stays where it is as long as its posterior is used.
void Linearize(const MapperOptions& options, BuildState* build, SolvedGraph* solved) {
  solved->graph = MakeGraph(options, build);
  solved->posterior = LinearizeForMap(solved->graph);
  if (!solved->posterior) return;
  solved->covariance = MapCovariance(solved->graph,
                                     *solved->posterior,
                                     ScaleSd(options, *build),
                                     build->distortion_root,
                                     build->disagreement);
  if (!IsDetermined(solved->covariance)) solved->posterior = nullptr;
}

// The same without runs that are undetermined by themselves: one log of absurd values does not fail
// the build.
Status LinearizeWhatIsDetermined(const MapperOptions& options,
                                 BuildState* build,
                                 SolvedGraph* solved) {
  Linearize(options, build, solved);
  if (!solved->posterior && RemoveUndeterminedRuns(options, build) > 0) {
    SHIFTMAP_RETURN_IF_ERROR(RemoveUntiedRuns(build));
    SHIFTMAP_RETURN_IF_ERROR(RequireRuns(!build->runs.empty(), build->left_out));
    build->disagreement = {};  // These are of other runs and modes.
    SolveWithDistortions(options, build);
    if (build->priors.empty()) AnchorFrame(build);
    Linearize(options, build, solved);
  }
  if (solved->posterior) return OkStatus();
  return InvalidArgument("the runs do not determine where their landmarks are");
}

// Placed runs may bring more modes than the memory estimate assumed. Leaves out the runs with most
// modes until the rest fits.
Status FitModes(const MapperOptions& options, BuildSize* size, BuildState* build) {
  for (;;) {
    size->modes = FlatModes(*build).end.value();
    const Status fits = CheckBuildMemory(*size, options.max_memory_bytes);
    if (fits.ok() || !RemoveRunWithMostModes(build)) return fits;
    SHIFTMAP_RETURN_IF_ERROR(RemoveUntiedRuns(build));
    if (build->runs.empty()) return OkStatus();
    if (build->priors.empty()) AnchorFrame(build);
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
    map.stamp = std::min(map.stamp, BeginOf(input.run));
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

std::vector<Signature> Named(const GroupSignatures& signatures,
                             const std::vector<GroupIndex>& groups) {
  std::vector<Signature> named;
  for (const GroupIndex group : groups) named.push_back(signatures[group]);
  return named;
}

AmbiguousChange Describe(const WaitingRuns& waiting, const GroupSignatures& signatures) {
  AmbiguousChange change;
  change.runs = waiting.runs;
  change.deciding = Named(signatures, waiting.explanations.deciding);
  if (waiting.misfit) {
    const JoinedFit& fit = *waiting.misfit;
    change.misfit = {Named(signatures, fit.groups), fit.chi2, fit.limit, fit.dof};
  }
  for (const Explanation& explanation : waiting.explanations.frames) {
    if (explanation.probability < kUnlikely && change.explanations.size() > 1) break;
    change.explanations.push_back({Named(signatures, explanation.alignment.signatures),
                                   Named(signatures, explanation.moved),
                                   explanation.probability});
  }
  return change;
}

AmbiguousChange Describe(const KeptAlternatives& kept, const GroupSignatures& signatures) {
  AmbiguousChange change;
  change.waits = false;
  change.runs = kept.runs;
  for (const StayedSet& stayed : kept.alternatives) {
    std::vector<GroupIndex> moved;
    std::set_difference(kept.groups.begin(),
                        kept.groups.end(),
                        stayed.groups.begin(),
                        stayed.groups.end(),
                        std::back_inserter(moved));
    change.explanations.push_back(
        {Named(signatures, stayed.groups), Named(signatures, moved), stayed.probability});
  }
  std::vector<GroupIndex> deciding;
  for (const KeptAlternatives::Doubt& doubt : kept.doubts) deciding.push_back(doubt.group);
  change.deciding = Named(signatures, deciding);
  return change;
}

void AddLeftOut(const BuildState& build, MapperResult* result) {
  result->rejected.insert(result->rejected.end(), build.left_out.begin(), build.left_out.end());
}

// Fills the result from a solved build.
Status Conclude(const GroupSignatures& signatures,
                const std::optional<MapContent>& prior,
                const MapperOptions& options,
                BuildState* build,
                MapperResult* result) {
  SolvedGraph solved;
  SHIFTMAP_RETURN_IF_ERROR(LinearizeWhatIsDetermined(options, build, &solved));
  SHIFTMAP_ASSIGN_OR_RETURN(MapOutput output,
                            MakeMapContent(*build, signatures, prior, solved.covariance, options));
  result->content = std::move(output.content);
  result->chains = std::move(output.chains);
  result->older = std::move(output.older);
  if (options.calibrate) {
    result->vehicles = CalibrateVehicles(options, solved.graph, *solved.posterior, *build);
  }
  if (prior) result->content.vehicles = prior->vehicles;
  UpdateVehicles(result->vehicles, &result->content.vehicles);
  SHIFTMAP_RETURN_IF_ERROR(ValidateMapContent(result->content));
  for (const RunIndex i : build->runs.indices()) {
    result->runs.push_back(MakeMappedRun(*build, i));
    result->runs.back().evidence = std::move(output.evidence[i]);
    result->runs.back().visibility = std::move(output.visibility[i]);
  }
  for (const GroupModes& group : build->modes) {
    for (const BuildMode& mode : group) result->modes_created += mode.number == kAbsent;
  }
  result->modes_merged = build->modes_merged;
  result->disagreement = build->disagreement.factor;
  result->selection = SummarizeSelection(options.modes, *build);
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
  const GroupSignatures signatures = AllSignatures(inputs, prior);
  const std::vector<MappingRun> runs = PrepareRuns(inputs, signatures, options, &result.rejected);
  SHIFTMAP_RETURN_IF_ERROR(RequireRuns(!runs.empty(), result.rejected));

  SHIFTMAP_ASSIGN_OR_RETURN(BuildState build,
                            PlaceRuns(runs, signatures, prior, options, &watch, &result.rejected));
  if (!build.runs.empty()) {
    SHIFTMAP_RETURN_IF_ERROR(FitModes(options, &size, &build));
  }
  if (!build.runs.empty()) {
    SHIFTMAP_ASSIGN_OR_RETURN(result.outer_iterations, RefineTogether(options, &watch, &build));
  }
  for (const WaitingRuns& waiting : build.waiting) {
    result.ambiguous_changes.push_back(Describe(waiting, signatures));
  }
  DropSettledAlternatives(&build);
  for (const KeptAlternatives& kept : build.kept) {
    result.ambiguous_changes.push_back(Describe(kept, signatures));
  }
  if (build.runs.empty()) {
    AddLeftOut(build, &result);
    SHIFTMAP_RETURN_IF_ERROR(RequireRuns(prior.has_value(), result.rejected));
    result.content = *prior;
    return result;
  }
  if (!prior) AnchorFrame(&build);
  watch.Report("covariance", 0.9, build);
  SHIFTMAP_RETURN_IF_ERROR(watch.status());
  SHIFTMAP_RETURN_IF_ERROR(Conclude(signatures, prior, options, &build, &result));
  AddLeftOut(build, &result);
  watch.Report("done", 1.0, build);
  SHIFTMAP_RETURN_IF_ERROR(watch.status());
  return result;
}

}  // namespace shiftmap
