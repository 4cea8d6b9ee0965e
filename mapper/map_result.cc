// SPDX-License-Identifier: Apache-2.0
#include "mapper/map_result.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <memory>
#include <utility>

#include "mapper/calibration/distortion_calibration.h"
#include "mapper/calibration/vehicle_update.h"
#include "mapper/covariance/mode_covariance.h"
#include "mapper/graph/graph_posterior.h"
#include "mapper/map_output.h"
#include "mapper/modes/unconstrained_runs.h"

namespace shiftmap {
namespace {

using GroupSignatures = IndexedVector<GroupIndex, Signature>;

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

}  // namespace

std::vector<AmbiguousChange> AmbiguousChangesOf(const BuildState& build,
                                                const GroupSignatures& signatures) {
  std::vector<AmbiguousChange> changes;
  for (const WaitingRuns& waiting : build.waiting) changes.push_back(Describe(waiting, signatures));
  for (const KeptAlternatives& kept : build.kept) changes.push_back(Describe(kept, signatures));
  return changes;
}

Status FillResult(const GroupSignatures& signatures,
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

}  // namespace shiftmap
