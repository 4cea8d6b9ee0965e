// SPDX-License-Identifier: Apache-2.0
#include "mapper/run_maps/unconfirmed_visits.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <map>
#include <optional>
#include <set>
#include <vector>

#include "mapper/frontend/frame_motions.h"
#include "mapper/state/sightings.h"
#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

// Where the difference of a visit from its mode is known as well as that, the visit ties nothing,
// and selection decides. [m]
constexpr double kHarmlessSd = 0.3;

// Area that the sensor sees, a sector around the sightings of a run. [m²]
double SeenArea(const MappingRun& run) {
  constexpr double kLeast = 1e-3;  // All sightings may be straight ahead.
  double range = 0.0;
  double bearing = 0.0;
  for (const Sighting& sighting : run.sightings) {
    const Eigen::Vector2d q = sighting.observation.PositionInVehicle();
    range = std::max(range, q.norm());
    bearing = std::max(bearing, std::abs(std::atan2(q.y(), q.x())));
  }
  return std::max(kLeast, range * range * bearing);
}

// A visit as a map without it has it.
struct Match {
  VisitRef visit;
  double density = 0.0;         // Of its place, over all modes of the landmark. [1/m²]
  GroupModeIndex likeliest{0};  // Of these.

  // Of the difference from it, in the direction with the largest. [m]
  double sd = std::numeric_limits<double>::infinity();
};

// Probability that each visit is misread.
// @param misfits  Visits at no mode, beside these.
// @param area     In which misread places are. [m²]
std::vector<double> MisreadProbabilities(const std::vector<Match>& matches,
                                         std::ptrdiff_t misfits,
                                         double area) {
  constexpr int kIterations = 50;
  std::vector<double> probabilities(matches.size());
  double share = 0.5;
  for (int i = 0; i < kIterations; ++i) {
    double sum = 1.0 + static_cast<double>(misfits);  // Beside those, one misread and one not.
    for (std::size_t k = 0; k < matches.size(); ++k) {
      const double misread = share / area;
      probabilities[k] = misread / (misread + (1.0 - share) * matches[k].density);
      sum += probabilities[k];
    }
    share = sum / (static_cast<double>(std::ssize(matches) + misfits) + 2.0);
  }
  return probabilities;
}

bool IsConfirmed(const ConfirmationOptions& options, const Match& match, double misread) {
  return misread <= 1.0 - options.min_probability || match.sd <= kHarmlessSd;
}

// A visit, with a mode of its own in a probing build.
struct Probe {
  VisitRef visit;
  GroupModeIndex own;
};

// @param modes  Of the landmark, before it had those of the probes.
Match MatchOf(const ModeOptions& options,
              const BuildState& probing,
              const ModeDifferences& differences,
              const FlatModes& flat,
              const Probe& probe,
              std::size_t modes) {
  const GroupIndex group = VisitOf(probing, probe.visit).group;
  const GroupModes& all = probing.modes[group];
  const Eigen::Matrix2d floor =
      Eigen::Matrix2d::Identity() * (2.0 * options.position_floor_m * options.position_floor_m);
  Match match{probe.visit};
  double highest = -1.0;
  for (GroupModeIndex k(0); k.value() < static_cast<int>(modes); ++k) {
    const Eigen::Matrix2d S =
        differences.ApproximateCovariance(flat.Index(group, probe.own), flat.Index(group, k)) +
        floor;
    const double density =
        std::exp(LogGaussian(all[probe.own].p_map_landmark - all[k].p_map_landmark, S));
    match.density += density / static_cast<double>(modes);
    if (density <= highest) continue;
    highest = density;
    match.likeliest = k;
    match.sd = LargestSd(S);
  }
  return match;
}

// Compares visits that are at no mode with the modes of their landmarks, which have one at least.
// Nothing matches if the others do not determine the map.
std::vector<Match> FindMatches(const MapperOptions& options,
                               const std::vector<VisitRef>& visits,
                               const BuildState& build) {
  std::vector<Match> matches;
  if (visits.empty()) return matches;
  BuildState probing = build;
  std::vector<Probe> probes;
  for (const VisitRef& ref : visits) {
    const MappingVisit& visit = VisitOf(build, ref);
    const VisitCluster cluster =
        ClusterOf(build.runs[ref.run], visit, options.modes.cluster_radius_m);
    const GroupModeIndex own = AddMode(visit.group, {cluster.centre, kAbsent}, &probing);
    AssignmentOf(&probing, ref) = own;
    probes.push_back({ref, own});
  }
  const Graph graph = MakeGraph(options, &probing);
  GraphSolver solver;
  const auto differences = ModeDifferences::Of(graph, &solver);
  const FlatModes flat(probing);
  for (const Probe& probe : probes) {
    const std::size_t modes = build.modes[VisitOf(build, probe.visit).group].size();
    matches.push_back(differences
                          ? MatchOf(options.modes, probing, *differences, flat, probe, modes)
                          : Match{probe.visit});
  }
  return matches;
}

// The same of visits that are at a mode, by the map without them. One that is alone at its mode
// ties nothing: it stays, others are compared with it, and it is not among the matches.
std::vector<Match> MatchesWithout(const MapperOptions& options,
                                  const BuildState& build,
                                  const std::vector<VisitRef>& visits) {
  BuildState others = build;
  for (const VisitRef& ref : visits) AssignmentOf(&others, ref) = kUnassigned;
  const std::vector<BuildModeRef> of_others = ModesOf(others.runs.front());
  std::set<BuildModeRef> held(of_others.begin(), of_others.end());
  std::vector<VisitRef> compared;
  for (const VisitRef& ref : visits) {
    const GroupModeIndex mode = *AssignmentOf(build, ref);
    if (held.insert({VisitOf(build, ref).group, mode}).second) {
      AssignmentOf(&others, ref) = mode;
    } else {
      compared.push_back(ref);
    }
  }
  return FindMatches(options, compared, others);
}

// Of visits that fit a map of one run, those that tie it and that no other visit confirms.
// @param misfits  Other visits, which fit nowhere.
std::vector<VisitRef> UnconfirmedTies(const MapperOptions& options,
                                      const BuildState& build,
                                      const std::vector<VisitRef>& visits,
                                      std::ptrdiff_t misfits) {
  const double area = SeenArea(*build.runs.front().data);
  std::map<VisitIndex, Match> matches;
  const auto compare_without = [&](const std::vector<VisitRef>& some) {
    for (const Match& match : MatchesWithout(options, build, some)) {
      matches[match.visit.visit] = match;
    }
  };
  const auto unconfirmed = [&] {
    std::vector<Match> list;
    for (const auto& [visit, match] : matches) list.push_back(match);
    const std::vector<double> misread = MisreadProbabilities(list, misfits, area);
    std::vector<VisitRef> result;
    for (std::size_t i = 0; i < list.size(); ++i) {
      if (!IsConfirmed(options.confirmation, list[i], misread[i])) result.push_back(list[i].visit);
    }
    return result;
  };
  compare_without(visits);
  // A visit that the map without all of these does not confirm may be confirmed by some of them. A
  // round compares every eighth: in a small run each by itself, and a large run needs few graphs.
  constexpr std::size_t kRounds = 8;
  const std::vector<VisitRef> doubtful = unconfirmed();
  for (std::size_t first = 0; first < std::min(kRounds, doubtful.size()); ++first) {
    std::vector<VisitRef> some;
    for (std::size_t i = first; i < doubtful.size(); i += kRounds) some.push_back(doubtful[i]);
    compare_without(some);
  }
  return unconfirmed();
}

// Visits that modes of their landmarks confirm.
int ConfirmByModes(const MapperOptions& options,
                   const std::vector<VisitRef>& visits,
                   BuildState* build) {
  IndexedVector<RunIndex, std::vector<Match>> matches(build->runs.size());
  for (const Match& match : FindMatches(options, visits, *build)) {
    matches[match.visit.run].push_back(match);
  }
  int confirmed = 0;
  for (const RunIndex r : build->runs.indices()) {
    BuildRun& run = build->runs[r];
    const std::vector<double> misread = MisreadProbabilities(matches[r], 0, SeenArea(*run.data));
    for (std::size_t i = 0; i < matches[r].size(); ++i) {
      const Match& match = matches[r][i];
      if (!IsConfirmed(options.confirmation, match, misread[i])) continue;
      run.unconfirmed[match.visit.visit] = false;
      if (misread[i] < 0.5) run.assignment[match.visit.visit] = match.likeliest;
      ++confirmed;
    }
  }
  return confirmed;
}

// Visits to landmarks without a mode that agree on a place, which gets one.
int ConfirmByEachOther(const ModeOptions& options,
                       const std::vector<VisitRef>& visits,
                       BuildState* build) {
  struct Seen {
    VisitRef visit;
    std::vector<Eigen::Vector2d> places;
  };
  std::map<GroupIndex, std::vector<Seen>> by_group;
  for (const VisitRef& ref : visits) {
    const MappingVisit& visit = VisitOf(*build, ref);
    by_group[visit.group].push_back({ref, VisitPositions(build->runs[ref.run], visit)});
  }
  int confirmed = 0;
  for (const auto& [group, seen] : by_group) {
    std::vector<Eigen::Vector2d> positions;
    for (const auto& [ref, places] : seen) {
      positions.insert(positions.end(), places.begin(), places.end());
    }
    const VisitCluster cluster = DensestCluster(positions, options.cluster_radius_m);
    if (cluster.count < options.min_sightings) continue;
    const GroupModeIndex mode = AddMode(group, {cluster.centre, kAbsent}, build);
    for (const auto& [ref, places] : seen) {
      const bool agrees =
          std::any_of(places.begin(), places.end(), [&](const Eigen::Vector2d& place) {
            return (place - cluster.centre).norm() <= options.cluster_radius_m;
          });
      if (!agrees) continue;
      build->runs[ref.run].unconfirmed[ref.visit] = false;
      AssignmentOf(build, ref) = mode;
      ++confirmed;
    }
  }
  return confirmed;
}

}  // namespace

IndexedVector<SightingIndex, bool> AgreeingSightings(const ModeOptions& options,
                                                     const MappingRun& run,
                                                     const FrameMotions& motions) {
  // Sightings of the visit before and after that are asked: odometry drifts.
  constexpr std::size_t kNeighbours = 10;
  const IndexedVector<FrameIndex, Se2> poses = DeadReckon(motions);
  IndexedVector<SightingIndex, bool> agreeing(run.sightings.size());
  for (const MappingVisit& visit : run.visits) {
    std::vector<Eigen::Vector2d> positions;
    for (const SightingIndex s : visit.sightings) {
      const Sighting& sighting = run.sightings[s];
      positions.push_back(poses[sighting.frame] * sighting.observation.PositionInVehicle());
    }
    for (std::size_t i = 0; i < positions.size(); ++i) {
      const auto begin = positions.begin();
      const auto agree = std::count_if(
          begin + static_cast<std::ptrdiff_t>(i - std::min(i, kNeighbours)),
          begin + static_cast<std::ptrdiff_t>(std::min(positions.size(), i + 1 + kNeighbours)),
          [&](const Eigen::Vector2d& other) {
            return (other - positions[i]).norm() <= options.cluster_radius_m;
          });
      agreeing[visit.sightings[i]] = agree >= options.min_sightings;
    }
  }
  return agreeing;
}

IndexedVector<VisitIndex, bool> VisitsWithout(const MappingRun& run,
                                              const IndexedVector<SightingIndex, bool>& sightings) {
  IndexedVector<VisitIndex, bool> without;
  for (const MappingVisit& visit : run.visits) {
    without.push_back(std::none_of(visit.sightings.begin(),
                                   visit.sightings.end(),
                                   [&](SightingIndex s) { return sightings[s]; }));
  }
  return without;
}

MappingRun OnlySightings(const MappingRun& run, const IndexedVector<SightingIndex, bool>& kept) {
  MappingRun part = run;
  part.sightings.clear();
  part.visits.clear();
  const IndexedVector<VisitIndex, bool> without = VisitsWithout(run, kept);
  IndexedVector<VisitIndex, VisitIndex> in_part(run.visits.size());
  for (const VisitIndex v : run.visits.indices()) {
    if (without[v]) continue;
    const MappingVisit& visit = run.visits[v];
    in_part[v] = part.visits.end_index();
    part.visits.push_back({visit.group, visit.begin, visit.end, {}});
  }
  for (KeyFrame& frame : part.frames) {
    const IndexRange<SightingIndex> sightings = frame.sightings();
    frame.first_sighting = part.sightings.end_index();
    for (const SightingIndex s : sightings) {
      if (!kept[s]) continue;
      Sighting sighting = run.sightings[s];
      sighting.visit = in_part[sighting.visit];
      part.visits[sighting.visit].sightings.push_back(part.sightings.end_index());
      part.sightings.push_back(sighting);
    }
    frame.sighting_count = part.sightings.end_index() - frame.first_sighting;
  }
  return part;
}

MappingRun WithoutUnconfirmed(const BuildRun& run) {
  IndexedVector<SightingIndex, bool> kept;
  for (const Sighting& sighting : run.data->sightings) {
    kept.push_back(!run.IsUnconfirmed(sighting.visit));
  }
  return OnlySightings(*run.data, kept);
}

IndexedVector<SightingIndex, bool> TrustedSightings(const MapperOptions& options,
                                                    const BuildState& build) {
  constexpr double kMany = 0.1;
  constexpr double kMostInPassing = 0.4;
  const BuildRun& run = build.runs.front();
  const MappingRun& data = *run.data;
  auto agreeing = AgreeingSightings(options.modes, data, run.motions);
  const auto unconfirmed = VisitsWithout(data, agreeing);
  std::vector<VisitRef> fitting;
  std::vector<VisitRef> misfits;
  std::ptrdiff_t sightings = 0;
  for (const VisitIndex v : unconfirmed.indices()) {
    if (!unconfirmed[v]) continue;
    const VisitRef ref{RunIndex(0), v};
    sightings += std::ssize(data.visits[v].sightings);
    (CountInliers(build, ref) > 0 ? fitting : misfits).push_back(ref);
  }
  const auto all = static_cast<double>(fitting.size() + misfits.size());
  const auto misfitting = static_cast<double>(misfits.size());
  const bool many = misfitting > 1.0 + kMany * all;
  const bool in_passing = 2 * sightings > std::ssize(data.sightings);
  if (many && (!in_passing || misfitting > kMostInPassing * all)) return agreeing;
  IndexedVector<SightingIndex, bool> trusted(agreeing.size(), true);
  if (in_passing && !many) return trusted;
  std::vector<VisitRef> doubtful = UnconfirmedTies(options, build, fitting, std::ssize(misfits));
  // A misfit would fit a map without these.
  if (!doubtful.empty()) doubtful.insert(doubtful.end(), misfits.begin(), misfits.end());
  for (const VisitRef& ref : doubtful) {
    for (const SightingIndex s : data.visits[ref.visit].sightings) trusted[s] = false;
  }
  return trusted;
}

int ConfirmVisits(const MapperOptions& options, BuildState* build) {
  std::vector<VisitRef> of_modes;
  std::vector<VisitRef> without_mode;
  for (const RunIndex r : build->runs.indices()) {
    const BuildRun& run = build->runs[r];
    for (const VisitIndex v : run.unconfirmed.indices()) {
      if (!run.unconfirmed[v]) continue;
      const bool has_mode = !build->modes[run.data->visits[v].group].empty();
      (has_mode ? of_modes : without_mode).push_back({r, v});
    }
  }
  int confirmed = 0;
  if (!of_modes.empty()) confirmed += ConfirmByModes(options, of_modes, build);
  confirmed += ConfirmByEachOther(options.modes, without_mode, build);
  return confirmed;
}

}  // namespace shiftmap
