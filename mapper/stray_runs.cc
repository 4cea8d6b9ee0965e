// SPDX-License-Identifier: Apache-2.0
#include "mapper/stray_runs.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "mapper/frontend/run_parts.h"
#include "mapper/mode_merging.h"
#include "mapper/single_run.h"
#include "mapper/submap.h"
#include "mapper/submap_alignment.h"

namespace shiftmap {
namespace {

// So many visits in a row that are of landmarks known elsewhere are no landmarks that moved.
constexpr int kStrayVisits = 6;

// Visits of a part: enough of them to be aligned, and no loop to close.
constexpr double kPartVisits = 24.0;

// A visit this near to a mode of the others is of that. [m]
constexpr double kSamePlace = 1.0;

// Groups that must agree in a part; three do so by accident.
constexpr std::size_t kMinSupport = 4;

// Per group and mode, how many runs have it. That the prior map does counts for nothing: landmarks
// may have moved since.
using Owners = std::vector<std::vector<int>>;

Owners NoOwners(const MapProblem& problem) {
  Owners owners;
  for (const std::vector<BuildMode>& group : problem.modes) owners.emplace_back(group.size());
  return owners;
}

// The modes that a run has, each once.
std::vector<std::pair<std::size_t, std::size_t>> ModesOf(const BuildRun& run) {
  std::vector<std::pair<std::size_t, std::size_t>> modes;
  for (std::size_t v = 0; v < run.assignment.size(); ++v) {
    if (run.assignment[v] == kUnassigned) continue;
    modes.emplace_back(run.data->visits[v].group, run.assignment[v]);
  }
  std::sort(modes.begin(), modes.end());
  modes.erase(std::unique(modes.begin(), modes.end()), modes.end());
  return modes;
}

void AddOwner(const BuildRun& run, int change, Owners* owners) {
  for (const auto& [group, mode] : ModesOf(run)) (*owners)[group][mode] += change;
}

// Shorter ones may be of a misread signature.
bool MakesMode(const ModeOptions& options, const MappingVisit& visit) {
  return std::ssize(visit.sightings) >= options.min_sightings;
}

// How the visits of a run, or of a stretch of it, agree with the others. Only visits that make a
// mode count.
struct Agreement {
  int shared = 0;     // Are where others have their landmark.
  int stray = 0;      // Are of landmarks that others know elsewhere.
  int stray_row = 0;  // Most of these in a row.
};

Agreement AgreementOf(
    const ModeOptions& options, const BuildRun& run, const Owners& others, Stamp begin, Stamp end) {
  Agreement agreement;
  int in_row = 0;
  for (std::size_t v = 0; v < run.assignment.size(); ++v) {
    const MappingVisit& visit = run.data->visits[v];
    if (run.assignment[v] == kUnassigned || !MakesMode(options, visit)) continue;
    if (visit.begin < begin || visit.begin > end) continue;
    const std::vector<int>& group = others[static_cast<std::size_t>(visit.group)];
    if (group[static_cast<std::size_t>(run.assignment[v])] > 0) {
      ++agreement.shared;
      in_row = 0;
    } else if (std::any_of(group.begin(), group.end(), [](int count) { return count > 0; })) {
      ++agreement.stray;
      agreement.stray_row = std::max(agreement.stray_row, ++in_row);
    }
  }
  return agreement;
}

Agreement AgreementOf(const ModeOptions& options, const BuildRun& run, const Owners& others) {
  const std::vector<KeyFrame>& frames = run.data->frames;
  return AgreementOf(options, run, others, frames.front().stamp, frames.back().stamp);
}

// The modes of others in the groups that a run has seen.
std::vector<AlignmentPoint> Reference(const MapProblem& problem,
                                      const Owners& others,
                                      const BuildRun& run) {
  std::vector<int> groups;
  for (const MappingVisit& visit : run.data->visits) groups.push_back(visit.group);
  std::sort(groups.begin(), groups.end());
  groups.erase(std::unique(groups.begin(), groups.end()), groups.end());
  std::vector<AlignmentPoint> points;
  for (const int g : groups) {
    const auto group = static_cast<std::size_t>(g);
    for (std::size_t m = 0; m < problem.modes[group].size(); ++m) {
      if (others[group][m] == 0) continue;
      points.push_back({g, problem.modes[group][m].p_map_landmark, Eigen::Matrix2d::Zero()});
    }
  }
  return points;
}

// Per visit of a run the mode of others that it is at, or kUnassigned.
std::vector<int> MatchVisits(const MapperOptions& options,
                             const MapProblem& problem,
                             const Owners& others,
                             const BuildRun& run) {
  std::vector<int> matches;
  for (const MappingVisit& visit : run.data->visits) {
    const Eigen::Vector2d centre =
        DensestCluster(VisitPositions(run, visit), options.modes.cluster_radius_m).centre;
    const auto group = static_cast<std::size_t>(visit.group);
    double least = kSamePlace;
    int& match = matches.emplace_back(kUnassigned);
    for (std::size_t m = 0; m < problem.modes[group].size(); ++m) {
      const double distance = (problem.modes[group][m].p_map_landmark - centre).norm();
      if (others[group][m] == 0 || distance >= least) continue;
      least = distance;
      match = static_cast<int>(m);
    }
  }
  return matches;
}

// The run with its poses where its parts align with the others, if any does.
// @param keep  Parts that agree with the others stay where they are.
std::optional<BuildRun> Realign(const MapperOptions& options,
                                const MapProblem& problem,
                                const Owners& others,
                                const BuildRun& run,
                                bool keep,
                                const GoOn& go_on) {
  const MappingRun& data = *run.data;
  const double duration = ToSeconds(data.frames.back().stamp - data.frames.front().stamp);
  const std::vector<AlignmentPoint> reference = Reference(problem, others, run);
  std::vector<Eigen::Vector2d> positions;
  for (const AlignmentPoint& point : reference) positions.push_back(point.position);
  const double area = OccupiedArea(positions);
  const auto visits =
      std::count_if(data.visits.begin(), data.visits.end(), [&](const MappingVisit& visit) {
        return MakesMode(options.modes, visit);
      });
  RunParts parts(data, duration * kPartVisits / static_cast<double>(visits));
  bool any = false;
  auto first = run.poses.begin();
  for (std::size_t k = 0; k < parts.size(); ++k) {
    const std::vector<KeyFrame>& frames = parts.At(k).frames;
    const auto begin = std::exchange(first, first + std::ssize(frames));
    const Agreement agreement =
        AgreementOf(options.modes, run, others, frames.front().stamp, frames.back().stamp);
    if (keep && agreement.shared > agreement.stray) {
      parts.Place(k, {begin, first});
      continue;
    }
    MapProblem part = MapPart(parts.At(k), run, problem.signatures, problem.sensor, options, go_on);
    if (go_on && !go_on(part)) return std::nullopt;
    const Submap submap = MakeSubmap(options, std::move(part));
    const auto aligned = AlignSubmap(reference, submap, area, options.alignment);
    if (!aligned || aligned->alignment.signatures.size() < kMinSupport) continue;
    std::vector<Se2> poses = submap.problem.runs.front().poses;
    for (Se2& pose : poses) pose = aligned->alignment.T_reference_other * pose;
    parts.Place(k, std::move(poses));
    any = true;
  }
  if (!any) return std::nullopt;
  BuildRun moved = run;
  moved.poses = parts.Poses(run.motions);
  return moved;
}

// What a run costs as it is assigned, with the modes of others held: its least cost, and what each
// mode of its own does.
double CostAmong(const MapperOptions& options,
                 const MapProblem& problem,
                 const Owners& others,
                 const BuildRun& run) {
  constexpr double kOwnModeCost = 10.0;
  MapProblem alone;
  alone.signatures = problem.signatures;
  alone.sensor = problem.sensor;
  alone.modes.resize(problem.modes.size());
  alone.runs.push_back(run);
  BuildRun& of_alone = alone.runs.front();
  std::map<std::pair<int, int>, int> known;  // Group and mode of the problem.
  std::vector<std::pair<int, int>> held;     // The same of `alone`.
  int own = 0;
  for (std::size_t v = 0; v < run.assignment.size(); ++v) {
    const int group = run.data->visits[v].group;
    std::vector<BuildMode>& modes = alone.modes[static_cast<std::size_t>(group)];
    const int mode = run.assignment[v];
    if (mode != kUnassigned) {
      const auto [entry, added] = known.try_emplace({group, mode}, static_cast<int>(modes.size()));
      of_alone.assignment[v] = entry->second;
      if (!added) continue;
      modes.push_back(
          problem.modes[static_cast<std::size_t>(group)][static_cast<std::size_t>(mode)]);
      if (others[static_cast<std::size_t>(group)][static_cast<std::size_t>(mode)] > 0) {
        held.emplace_back(group, entry->second);
      } else {
        ++own;
      }
      continue;
    }
    const Eigen::Vector2d centre =
        DensestCluster(VisitPositions(run, run.data->visits[v]), options.modes.cluster_radius_m)
            .centre;
    const auto near = std::find_if(modes.begin(), modes.end(), [&](const BuildMode& other) {
      return (other.p_map_landmark - centre).norm() < kSamePlace;
    });
    of_alone.assignment[v] = static_cast<int>(near - modes.begin());
    if (near != modes.end()) continue;
    modes.push_back({centre, kAbsent, false});
    ++own;
  }
  const FlatModes flat(alone);
  const auto rows = static_cast<Eigen::Index>(2 * held.size());
  alone.prior.mean.resize(rows);
  for (const auto& [group, mode] : held) {
    alone.prior.mean.segment<2>(static_cast<Eigen::Index>(2 * alone.prior.modes.size())) =
        alone.modes[static_cast<std::size_t>(group)][static_cast<std::size_t>(mode)].p_map_landmark;
    alone.prior.modes.push_back(flat.Index(group, mode));
  }
  alone.prior.sqrt_information =
      Eigen::MatrixXd::Identity(rows, rows) / options.modes.position_floor_m;
  SolveContinuous(options, &alone);  // Its parts may be metres from where they belong.
  alone.loss_reach = problem.loss_reach;
  SolveContinuous(options, &alone);
  return alone.cost + kOwnModeCost * own;
}

}  // namespace

int PutBackStrayRuns(const MapperOptions& options, MapProblem* problem, const GoOn& go_on) {
  Owners owners = NoOwners(*problem);
  for (const BuildRun& run : problem->runs) AddOwner(run, 1, &owners);
  int count = 0;
  for (BuildRun& run : problem->runs) {
    AddOwner(run, -1, &owners);
    const Agreement before = AgreementOf(options.modes, run, owners);
    if (before.stray_row >= kStrayVisits) {
      double least = CostAmong(options, *problem, owners, run);
      std::optional<BuildRun> best;
      for (const bool keep : {true, false}) {
        std::optional<BuildRun> moved = Realign(options, *problem, owners, run, keep, go_on);
        if (go_on && !go_on(*problem)) return count;
        if (!moved) continue;
        moved->assignment = MatchVisits(options, *problem, owners, *moved);
        if (AgreementOf(options.modes, *moved, owners).shared <= before.shared) continue;
        const double cost = CostAmong(options, *problem, owners, *moved);
        if (cost >= least) continue;
        least = cost;
        best = std::move(moved);
      }
      count += best.has_value();
      if (best) run = *std::move(best);
    }
    AddOwner(run, 1, &owners);
  }
  if (count > 0) DropUnusedModes(problem);
  return count;
}

}  // namespace shiftmap
