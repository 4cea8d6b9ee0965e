// SPDX-License-Identifier: Apache-2.0
#include "mapper/registration/misregistered_runs.h"

#include <algorithm>
#include <cstddef>
#include <iterator>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "mapper/frontend/frame_motions.h"
#include "mapper/frontend/run_parts.h"
#include "mapper/modes/mode_merging.h"
#include "mapper/registration/run_among_others.h"
#include "mapper/registration/run_map_alignment.h"
#include "mapper/run_maps/run_map.h"
#include "mapper/run_maps/single_run.h"
#include "mapper/run_maps/unconfirmed_visits.h"
#include "mapper/state/sightings.h"

namespace shiftmap {
namespace {

// The modes of others in the groups that a run has seen.
AlignmentPoints Reference(const BuildState& build, const Owners& others, const BuildRun& run) {
  std::set<GroupIndex> groups;
  for (const MappingVisit& visit : run.data->visits) groups.insert(visit.group);
  return PointsOfGroups(build, groups, HasOwner(others));
}

// A run in parts, and the poses of those that align with the others, none of the rest.
struct AlignedParts {
  RunParts parts;
  std::vector<std::vector<Se2>> poses;
};

// Nothing if `on_step` says no.
std::optional<AlignedParts> AlignParts(const MapperOptions& options,
                                       const BuildState& build,
                                       const Owners& others,
                                       const BuildRun& run,
                                       const StepCallback& on_step) {
  std::optional<MappingRun> confirmed;
  const MappingRun& data =
      run.unconfirmed.empty() ? *run.data : confirmed.emplace(WithoutUnconfirmed(run));
  const auto visits =
      std::count_if(data.visits.begin(), data.visits.end(), [&](const MappingVisit& visit) {
        return MakesMode(options.modes, visit);
      });
  const double part_s =
      DurationOf(data) * options.relocation.part_visits / static_cast<double>(visits);
  AlignedParts aligned{RunParts(data, part_s, BrokenMotions(run.motions)), {}};
  const AlignmentPoints reference = Reference(build, others, run);
  const double area = OccupiedArea(PositionsOf(reference));
  for (std::size_t k = 0; k < aligned.parts.size(); ++k) {
    BuildState part = MapPart(options, build, run, aligned.parts.At(k), on_step);
    if (on_step && !on_step(part)) return std::nullopt;
    std::vector<Se2>& poses = aligned.poses.emplace_back();
    const std::optional<RunMap> run_map = MakeRunMap(options, std::move(part));
    if (!run_map) continue;
    const auto found = AlignRunMap(reference, *run_map, area, options.alignment);
    if (!found || found->alignment.signatures.size() < kMinPartSignatures) continue;
    for (const Se2& pose : run_map->build.runs.front().poses) {
      poses.push_back(found->alignment.T_reference_other * pose);
    }
  }
  return aligned;
}

// The run with its poses where its parts align with the others, if any does.
// @param keep  Parts that agree with the others stay where they are.
std::optional<BuildRun> Realigned(const MapperOptions& options,
                                  const BuildState& build,
                                  const Owners& others,
                                  const BuildRun& run,
                                  bool keep,
                                  AlignedParts* aligned) {
  bool any = false;
  auto first = run.poses.begin();
  for (std::size_t k = 0; k < aligned->parts.size(); ++k) {
    const auto& frames = aligned->parts.At(k).frames;
    const auto begin = std::exchange(first, first + std::ssize(frames));
    const Agreement agreement =
        AgreementOf(options.modes, run, others, frames.front().stamp, frames.back().stamp);
    if (keep && agreement.shared > agreement.contradicting) {
      aligned->parts.Place(k, {begin, first});
    } else {
      aligned->parts.Place(k, aligned->poses[k]);
      any = any || !aligned->poses[k].empty();
    }
  }
  if (!any) return std::nullopt;
  BuildRun realigned = run;
  realigned.poses = aligned->parts.Poses(run.motions);
  realigned.assignment =
      MatchVisits(options, build, others, realigned, options.relocation.same_place_m);
  return realigned;
}

// The run pulled to the places of others. A visit that is not at one then, to half of the distance
// that counts for parts that may be turned, is of a landmark that moved.
BuildRun PulledOnto(const MapperOptions& options,
                    const BuildState& build,
                    const Owners& others,
                    const BuildRun& run) {
  BuildRun pulled = Pulled(options, build, others, run);
  pulled.assignment =
      MatchVisits(options, build, others, pulled, 0.5 * options.relocation.same_place_m);
  return pulled;
}

// A misregistered run where it costs less than where it is, or nothing.
std::optional<BuildRun> Relocate(const MapperOptions& options,
                                 const BuildState& build,
                                 const Owners& others,
                                 const BuildRun& run,
                                 const StepCallback& on_step) {
  const Agreement before = AgreementOf(options.modes, run, others);
  const bool lays_second_map = before.contradicting_row >= options.relocation.min_visits;
  if (!lays_second_map && (std::ssize(before.elsewhere) < options.relocation.min_visits ||
                           !MayBeDeformed(options, build, others, run))) {
    return std::nullopt;
  }
  std::optional<double> least;  // Solved for only if a candidate is to be held against it.
  std::optional<BuildRun> best;
  const auto consider = [&](BuildRun moved, bool has_to_fit) {
    if (AgreementOf(options.modes, moved, others).shared <= before.shared) return;
    if (!least) least = CostAmong(SolvedAmong(options, build, others, run));
    const BuildState solved = SolvedAmong(options, build, others, moved);
    const double cost = CostAmong(solved);
    if (cost >= *least || (has_to_fit && !FitsAmong(options, solved))) return;
    least = cost;
    best = std::move(moved);
  };
  consider(PulledOnto(options, build, others, run), true);
  if (!lays_second_map) return best;
  std::optional<AlignedParts> aligned = AlignParts(options, build, others, run, on_step);
  if (!aligned) return std::nullopt;
  for (const bool keep : {true, false}) {
    std::optional<BuildRun> moved = Realigned(options, build, others, run, keep, &*aligned);
    if (moved) consider(*std::move(moved), false);
  }
  return best;
}

}  // namespace

int RelocateMisregisteredRuns(const MapperOptions& options,
                              BuildState* build,
                              const StepCallback& on_step) {
  Owners owners = OwnersOf(*build);
  int count = 0;
  for (BuildRun& run : build->runs) {
    if (on_step && !on_step(*build)) break;
    AddOwner(run, -1, &owners);
    if (std::optional<BuildRun> moved = Relocate(options, *build, owners, run, on_step)) {
      run = *std::move(moved);
      ++count;
    }
    AddOwner(run, 1, &owners);
  }
  if (count > 0) DropUnusedModes(build);
  return count;
}

}  // namespace shiftmap
