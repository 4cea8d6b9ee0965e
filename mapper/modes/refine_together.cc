// SPDX-License-Identifier: Apache-2.0
#include "mapper/modes/refine_together.h"

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

#include "mapper/calibration/detection.h"
#include "mapper/calibration/distortion_calibration.h"
#include "mapper/calibration/noise_calibration.h"
#include "mapper/graph/graph.h"
#include "mapper/modes/mode_merging.h"
#include "mapper/modes/mode_refinement.h"
#include "mapper/modes/unconstrained_runs.h"
#include "mapper/registration/ambiguous_runs.h"
#include "mapper/registration/misfit_runs.h"
#include "mapper/registration/misregistered_runs.h"
#include "mapper/run_maps/run_variances.h"
#include "mapper/run_maps/unconfirmed_visits.h"

namespace shiftmap {
namespace {

// A run that is relocated may be the one with which another has to agree.
constexpr int kRelocationRounds = 3;

// Poses runs without the modes that were displaced from one of several places of the prior map. A
// run by itself may have one mode of a door, between its places, and poses that fit this mode: with
// them selection cannot assign the visits to the places. A run keeps its poses if most of its modes
// are such modes, or too few others of the prior map tie it.
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

}  // namespace

StatusOr<int> RefineTogether(const MapperOptions& options, BuildWatch* watch, BuildState* build) {
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

}  // namespace shiftmap
