// SPDX-License-Identifier: Apache-2.0
#include "mapper/registration/misfit_runs.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>
#include <utility>
#include <vector>

#include "mapper/covariance/gauge.h"
#include "mapper/modes/mode_merging.h"
#include "mapper/modes/unconstrained_runs.h"
#include "mapper/parallel.h"
#include "mapper/registration/mode_match.h"
#include "mapper/run_maps/variance_factor.h"
#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

// A run by itself with the modes that it has in a joint map, and where that map has them.
struct RunAlone {
  BuildState build;
  std::vector<GroupIndex> groups;       // Of the modes that others or the prior map have as well.
  std::vector<ModeIndex> shared;        // These modes.
  std::vector<Eigen::Vector2d> places;  // And their positions in the joint map. [m]
};

const BuildMode& ModeAt(const BuildState& build, const BuildModeRef& mode) {
  return build.modes[mode.group][mode.mode];
}

// The modes that a run has and another one, or the prior map, has as well.
std::vector<BuildModeRef> SharedModes(const BuildState& build, RunIndex run) {
  std::set<BuildModeRef> of_others;
  for (const RunIndex r : build.runs.indices()) {
    if (r == run) continue;
    for (const BuildModeRef& mode : ModesOf(build.runs[r])) of_others.insert(mode);
  }
  std::vector<BuildModeRef> modes = ModesOf(build.runs[run]);
  std::erase_if(modes, [&](const BuildModeRef& mode) {
    return ModeAt(build, mode).number == kAbsent && !of_others.contains(mode);
  });
  return modes;
}

RunAlone TakeAlone(const BuildState& build, RunIndex run, const std::vector<BuildModeRef>& shared) {
  RunAlone alone;
  alone.build = RunByItself(build, run);
  const std::vector<BuildModeRef> own = ModesOf(build.runs[run]);  // In their flat order.
  for (const BuildModeRef& mode : shared) {
    const auto at = std::lower_bound(own.begin(), own.end(), mode);
    alone.shared.emplace_back(at - own.begin());
    alone.places.push_back(ModeAt(build, mode).p_map_landmark);
  }
  return alone;
}

// Takes out modes of which the run by itself is much nearer to another one of the group: selection,
// by the time of its visits, took the wrong one, which says nothing of where the run is.
// @param shared  Of the joint map, as alone->shared.
void DropMistaken(double distance_ratio,
                  const BuildState& build,
                  const std::vector<BuildModeRef>& shared,
                  RunAlone* alone) {
  const IndexedVector<ModeIndex, Eigen::Vector2d> positions = ModePositions(alone->build);
  RunAlone kept{std::move(alone->build), {}, {}, {}};
  for (std::size_t i = 0; i < shared.size(); ++i) {
    const Eigen::Vector2d& p = positions[alone->shared[i]];
    const double squared = (alone->places[i] - p).squaredNorm();
    if (distance_ratio * distance_ratio * FindNearest(build, shared[i].group, p).squared_m2 <
        squared)
      continue;
    kept.groups.push_back(shared[i].group);
    kept.shared.push_back(alone->shared[i]);
    kept.places.push_back(alone->places[i]);
  }
  *alone = std::move(kept);
}

// Cost of a run with some modes held.
double CostHeld(const MapperOptions& options, BuildState held, const RunAlone& alone, double sd_m) {
  held.priors = HoldModes(alone.shared, alone.places, sd_m);
  SolveContinuous(options, &held);
  return held.cost;
}

}  // namespace

std::optional<JoinedFit> FitJoined(const MapperOptions& options,
                                   const BuildState& build,
                                   RunIndex run) {
  const std::vector<BuildModeRef> shared = SharedModes(build, run);
  const auto own = std::ssize(ModesOf(build.runs[run]));
  if (shared.size() < ShapeCovariance::kMinModes || own > options.confirmation.max_modes)
    return std::nullopt;
  RunAlone alone = TakeAlone(build, run, shared);
  // The scale of its ranges is free.
  MapperOptions scaled = options;
  scaled.sd_run_range_scale =
      std::numbers::sqrt2 * std::hypot(options.sd_range_scale, options.sd_run_range_scale);
  alone.build.in_map_units = true;

  const BuildState joined = alone.build;
  SolveContinuous(scaled, &alone.build);
  DropMistaken(options.confirmation.mistaken_distance_ratio, build, shared, &alone);
  if (alone.shared.size() < ShapeCovariance::kMinModes) return std::nullopt;
  JoinedFit fit;
  fit.groups = alone.groups;
  fit.groups.erase(std::unique(fit.groups.begin(), fit.groups.end()), fit.groups.end());
  fit.dof = static_cast<int>(2 * alone.shared.size()) - ShapeCovariance::kGauge;
  fit.limit = ChiSquareQuantile(1.0 - options.confirmation.false_misfit, fit.dof);
  const double sd_m = options.modes.position_floor_m / std::numbers::sqrt2;
  const double least = alone.build.cost;
  fit.chi2 = 2.0 * (CostHeld(scaled, joined, alone, sd_m) - least);
  if (fit.is_good()) return fit;
  const double factor = VarianceFactor(scaled, alone.build);
  fit.chi2 = 2.0 * (CostHeld(scaled, joined, alone, sd_m / std::sqrt(factor)) - least) / factor;
  return fit;
}

WaitingRuns& LetWait(RunIndex run, BuildState* build) {
  const MappingRun& data = *build->runs[run].data;
  WaitingRuns& waiting = build->waiting.emplace_back();
  waiting.runs.push_back({data.name, data.sha256});
  build->runs.erase(build->runs.begin() + run.value());
  DropUnusedModes(build);
  if (!build->runs.empty()) RemoveUnconstrainedRuns(build);
  return waiting;
}

bool RemoveMisfitRun(const MapperOptions& options, BuildState* build) {
  MapperOptions of_one = options;
  of_one.threads = 1;
  IndexedVector<RunIndex, std::optional<JoinedFit>> fits(build->runs.size());
  ForEachIndex(fits.size(), options.threads, [&](std::size_t i) {
    const RunIndex r(i);
    fits[r] = FitJoined(of_one, *build, r);
  });
  std::optional<RunIndex> worst;
  const auto excess = [&](RunIndex r) { return fits[r]->chi2 / fits[r]->limit; };
  for (const RunIndex r : fits.indices()) {
    if (!fits[r] || fits[r]->is_good() || (worst && excess(r) <= excess(*worst))) continue;
    worst = r;
  }
  if (!worst) return false;
  LetWait(*worst, build).misfit = std::move(fits[*worst]);
  return true;
}

}  // namespace shiftmap
