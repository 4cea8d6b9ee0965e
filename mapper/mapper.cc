// SPDX-License-Identifier: Apache-2.0
#include "mapper/mapper.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstddef>
#include <utility>

#include "mapper/association/track_names.h"
#include "mapper/map_result.h"
#include "mapper/memory_estimate.h"
#include "mapper/modes/doubtful_modes.h"
#include "mapper/modes/refine_together.h"
#include "mapper/modes/unconstrained_runs.h"
#include "mapper/parallel.h"
#include "mapper/registration/place_runs.h"
#include "mapper/run_maps/map_runs.h"
#include "mapper/state/build_state.h"

namespace shiftmap {
namespace {

using GroupSignatures = IndexedVector<GroupIndex, Signature>;

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

// Landmarks without signature get the names of their tracks.
Status NameAnonymous(const MapperOptions& options,
                     BuildWatch* watch,
                     std::vector<MapperInput>* inputs) {
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

BuildSize SizeOf(const std::vector<MapperInput>& inputs,
                 const std::optional<MapContent>& prior,
                 const MapperOptions& options) {
  BuildSize size;
  size.runs_at_once = std::min<std::int64_t>(options.threads, std::ssize(inputs));
  if (prior) size.prior_modes = prior->covariance.size();
  for (const MapperInput& input : inputs) AddRun(input.run, &size);
  return size;
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
  BuildWatch watch(monitor);
  SHIFTMAP_RETURN_IF_ERROR(NameAnonymous(options, &watch, &inputs));
  const GroupSignatures signatures = AllSignatures(inputs, prior);
  const std::vector<MappingRun> runs = PrepareRuns(inputs, signatures, options, &result.rejected);
  SHIFTMAP_RETURN_IF_ERROR(RequireRuns(!runs.empty(), result.rejected));

  SHIFTMAP_ASSIGN_OR_RETURN(std::vector<RunMap> run_maps,
                            MapRuns(runs, signatures.size(), options, &watch, &result.rejected));
  SHIFTMAP_ASSIGN_OR_RETURN(
      BuildState build,
      PlaceRuns(std::move(run_maps), signatures, prior, options, &watch, &result.rejected));
  if (!build.runs.empty()) {
    SHIFTMAP_RETURN_IF_ERROR(FitModes(options, &size, &build));
  }
  if (!build.runs.empty()) {
    SHIFTMAP_ASSIGN_OR_RETURN(result.outer_iterations, RefineTogether(options, &watch, &build));
  }
  DropSettledAlternatives(&build);
  result.ambiguous_changes = AmbiguousChangesOf(build, signatures);
  const bool any = !build.runs.empty();
  if (any) {
    if (!prior) AnchorFrame(&build);
    watch.Report("covariance", 0.9, build);
    SHIFTMAP_RETURN_IF_ERROR(watch.status());
    SHIFTMAP_RETURN_IF_ERROR(FillResult(signatures, prior, options, &build, &result));
  }
  result.rejected.insert(result.rejected.end(), build.left_out.begin(), build.left_out.end());
  if (!any) {
    SHIFTMAP_RETURN_IF_ERROR(RequireRuns(prior.has_value(), result.rejected));
    result.content = *prior;
    return result;
  }
  watch.Report("done", 1.0, build);
  SHIFTMAP_RETURN_IF_ERROR(watch.status());
  return result;
}

}  // namespace shiftmap
