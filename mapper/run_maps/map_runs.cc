// SPDX-License-Identifier: Apache-2.0
#include "mapper/run_maps/map_runs.h"

#include <fmt/format.h>

#include <algorithm>
#include <optional>
#include <string>
#include <utility>

#include "mapper/calibration/implausible_calibration.h"
#include "mapper/calibration/noise_calibration.h"
#include "mapper/modes/unconstrained_runs.h"
#include "mapper/parallel.h"
#include "mapper/run_maps/single_run.h"
#include "mapper/state/sightings.h"

namespace shiftmap {
namespace {

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

}  // namespace

StatusOr<std::vector<RunMap>> MapRuns(const std::vector<MappingRun>& runs,
                                      std::size_t groups,
                                      const MapperOptions& options,
                                      BuildWatch* watch,
                                      std::vector<RejectedRun>* rejected) {
  MapperOptions alone = options;  // Each run gets an equal share of the threads.
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

}  // namespace shiftmap
