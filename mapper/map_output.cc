// SPDX-License-Identifier: Apache-2.0
#include "mapper/map_output.h"

#include <algorithm>
#include <utility>

#include "mapper/association/anonymous_landmarks.h"
#include "mapper/association/track_names.h"
#include "mapper/calibration/fleet_calibration.h"
#include "mapper/modes/missed_visits.h"
#include "mapper/modes/mode_refinement.h"
#include "mapstore/map/mode_filter.h"

namespace shiftmap {
namespace {

constexpr double kMinProbability = 1e-6;

// A mode of the problem that is none of the map's: it has no signature.
constexpr int kNoPlace = -1;

// The states of a group of the problem, `absent` first, in the order of the map's modes.
std::vector<Eigen::Index> StatesInOrder(const std::vector<std::size_t>& mode_order) {
  std::vector<Eigen::Index> states = {0};
  for (const std::size_t mode : mode_order) states.push_back(static_cast<Eigen::Index>(mode) + 1);
  return states;
}

const LandmarkGroup* FindGroup(const std::optional<MapContent>& map, const Signature& signature) {
  if (!map) return nullptr;
  const auto found =
      std::lower_bound(map->groups.begin(),
                       map->groups.end(),
                       signature,
                       [](const LandmarkGroup& a, const Signature& b) { return a.signature < b; });
  return found != map->groups.end() && found->signature == signature ? &*found : nullptr;
}

// Modes of a group in the order they get: the prior's by number, then new ones by first visit.
std::vector<std::size_t> ModeOrder(const MapProblem& problem,
                                   const std::vector<VisitRef>& visits,
                                   const std::vector<BuildMode>& modes) {
  std::vector<std::size_t> order;
  std::vector<std::size_t> first_visit(modes.size(), visits.size());
  for (std::size_t v = visits.size(); v-- > 0;) {
    const int mode = AssignmentOf(problem, visits[v]);
    if (mode != kUnassigned) first_visit[static_cast<std::size_t>(mode)] = v;
  }
  for (std::size_t i = 0; i < modes.size(); ++i) order.push_back(i);
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    const bool a_known = modes[a].number != kAbsent;
    const bool b_known = modes[b].number != kAbsent;
    if (a_known != b_known) return a_known;
    return a_known ? modes[a].number < modes[b].number : first_visit[a] < first_visit[b];
  });
  return order;
}

Stamp LastSeen(const MapProblem& problem,
               const std::vector<VisitRef>& visits,
               int mode,
               Stamp known) {
  for (const VisitRef& ref : visits) {
    if (AssignmentOf(problem, ref) == mode) known = std::max(known, VisitOf(problem, ref).end);
  }
  return known;
}

// What the prior map knew of a group when it was made: its distribution over the states of the
// problem, and the time at which that holds. A landmark at no known position may have stood at a
// mode that is new, so these share the probability of `absent`. Without a prior, all states alike
// at the begin of the first run.
struct GroupStart {
  Eigen::VectorXd probabilities;
  Stamp stamp;
};

GroupStart StartOf(const MapProblem& problem,
                   const std::vector<BuildMode>& modes,
                   const LandmarkGroup* known,
                   const std::optional<MapContent>& prior) {
  const auto states = static_cast<Eigen::Index>(modes.size()) + 1;
  GroupStart start{Eigen::VectorXd::Ones(states), problem.runs.front().data->begin()};
  if (known != nullptr) {
    start.stamp = prior->stamp;
    const auto unknown = 1 + std::count_if(modes.begin(), modes.end(), [&](const BuildMode& mode) {
                           return known->StateOf(mode.number) <= 0;
                         });
    start.probabilities.setConstant(known->probabilities[0] / static_cast<double>(unknown));
    for (std::size_t k = 0; k < modes.size(); ++k) {
      const int state = known->StateOf(modes[k].number);
      if (state <= 0) continue;
      start.probabilities[static_cast<Eigen::Index>(k) + 1] = known->probabilities[state];
    }
    start.probabilities = start.probabilities.cwiseMax(kMinProbability);
  }
  start.probabilities /= start.probabilities.sum();
  return start;
}

// The evidence of one visit of this build, with sightings or without.
struct BuildVisit {
  int run = 0;  // Index in MapProblem::runs.
  Stamp begin;
  Stamp end;
  Eigen::VectorXd log_likelihoods;  // Per state, `absent` first, in the order of the map's modes.
};

// A group of the map and where it comes from.
struct GroupSource {
  std::size_t group = 0;             // In the problem.
  std::vector<std::size_t> order;    // The problem's modes in the order of the map's.
  std::vector<VisitRef> visits;      // In the order of time.
  std::vector<BuildVisit> evidence;  // In the order of time, those without sightings included.
};

std::vector<BuildVisit> EvidenceOf(const MapProblem& problem,
                                   const GroupSource& source,
                                   const std::vector<MissedVisit>& missed,
                                   const ModeOptions& options) {
  const std::vector<Eigen::Index> states = StatesInOrder(source.order);
  std::vector<BuildVisit> evidence;
  for (const VisitRef& ref : source.visits) {
    const MappingVisit& visit = VisitOf(problem, ref);
    evidence.push_back(
        {ref.run, visit.begin, visit.end, VisitLogLikelihood(problem, ref, options)(states)});
  }
  for (const MissedVisit& visit : missed) {
    evidence.push_back({visit.run, visit.begin, visit.end, visit.log_likelihoods(states)});
  }
  std::stable_sort(evidence.begin(), evidence.end(), [](const auto& a, const auto& b) {
    return a.begin < b.begin;
  });
  return evidence;
}

// A group of the map without probabilities, its chain as the prior map has it.
LandmarkGroup MakeGroup(const MapProblem& problem,
                        const std::vector<Signature>& signatures,
                        const GroupSource& source,
                        const std::optional<MapContent>& prior,
                        const ModeOptions& options) {
  const std::vector<BuildMode>& modes = problem.modes[source.group];
  const LandmarkGroup* known = FindGroup(prior, signatures[source.group]);
  LandmarkGroup group;
  group.signature = signatures[source.group];
  group.chain = ModeChain::Uniform(
      static_cast<int>(modes.size()),
      known != nullptr ? known->chain.leave_rate_per_s() : options.leave_rate_per_s);
  // Rates between the same modes go on; with another mode they say nothing of it.
  if (known != nullptr && known->modes.size() == modes.size()) group.chain = known->chain;
  if (known != nullptr) group.merged = known->merged;
  ModeNumber next = known != nullptr ? known->NextNumber() : ModeNumber(1);
  for (const std::size_t k : source.order) {
    const int known_state =
        known != nullptr && modes[k].number != kAbsent ? known->StateOf(modes[k].number) : 0;
    Mode mode;
    mode.number = known_state > 0 ? modes[k].number : next;
    if (known_state <= 0) next = ModeNumber(next.value() + 1);
    mode.p_map_landmark = modes[k].p_map_landmark;
    const Stamp known_last = known_state > 0
                                 ? known->modes[static_cast<std::size_t>(known_state) - 1].last_seen
                                 : Stamp();
    mode.last_seen = LastSeen(problem, source.visits, static_cast<int>(k), known_last);
    group.modes.push_back(mode);
  }
  return group;
}

// This build's evidence of a group as rows of the ledger.
void AddRows(const MapProblem& problem,
             const GroupSource& source,
             const LandmarkGroup& group,
             std::vector<EvidenceRow>* rows) {
  for (const BuildVisit& visit : source.evidence) {
    const MappingRun& run = *problem.runs[static_cast<std::size_t>(visit.run)].data;
    EvidenceRow row{
        run.sha256,
        {group.signature, visit.begin, visit.end, {{kAbsent, visit.log_likelihoods[0]}}}};
    for (std::size_t i = 0; i < group.modes.size(); ++i) {
      row.evidence.modes.push_back(
          {group.modes[i].number, visit.log_likelihoods[static_cast<Eigen::Index>(i) + 1]});
    }
    rows->push_back(std::move(row));
  }
}

// Gives the groups the chains that the ledger and this build's visits speak for. A known group that
// neither tells of keeps its own.
StatusOr<std::vector<GroupChain>> LearnChainsOf(const MapProblem& problem,
                                                const std::vector<GroupSource>& sources,
                                                const std::optional<MapContent>& prior,
                                                const MapperOptions& options,
                                                std::vector<LandmarkGroup>* groups) {
  std::vector<EvidenceRow> evidence = options.chains.ledger;
  for (std::size_t i = 0; i < sources.size(); ++i) {
    AddRows(problem, sources[i], (*groups)[i], &evidence);
  }
  GroupChainOptions learning = options.chains.learning;
  learning.leave_rate_per_s = options.modes.leave_rate_per_s;
  learning.threads = options.threads;
  SHIFTMAP_ASSIGN_OR_RETURN(std::vector<GroupChain> chains,
                            LearnGroupChains(*groups, evidence, learning));
  for (std::size_t i = 0; i < chains.size(); ++i) {
    LandmarkGroup& group = (*groups)[i];
    const bool known = FindGroup(prior, group.signature) != nullptr;
    if (chains[i].learned || !known) group.chain = chains[i].chain.chain();
  }
  return chains;
}

// The filter of the group's chain over its visits, as the map's readers filter theirs: T-IV (13,
// 14). Visits that began before the prior's stamp come late, and do not overrule what is newer.
void SetProbabilities(const MapProblem& problem,
                      const GroupSource& source,
                      const std::optional<MapContent>& prior,
                      Stamp end,
                      LandmarkGroup* group) {
  const LandmarkGroup* known = FindGroup(prior, group->signature);
  const GroupStart start = StartOf(problem, problem.modes[source.group], known, prior);
  group->probabilities = start.probabilities(StatesInOrder(source.order));
  ModeState late = StationaryStart(*group, start.stamp);
  ModeState now = StartModes(*group, start.stamp);
  const auto filter = [&](auto first, auto last, ModeState* state) {
    for (auto visit = first; visit != last; ++visit) {
      AddVisit(*group, visit->begin, visit->end, visit->log_likelihoods, state);
    }
  };
  const auto first = source.evidence.begin();
  const auto newer =
      std::partition_point(first, source.evidence.end(), [&](const BuildVisit& visit) {
        return visit.begin < start.stamp;
      });
  filter(first, newer, &late);
  if (newer != first) AddLateVisits(*group, late, &now);
  filter(newer, source.evidence.end(), &now);
  group->probabilities = ProbabilitiesAt(*group, now, end).cwiseMax(kMinProbability);
  group->probabilities /= group->probabilities.sum();
}

// The end of the newest run, but not ahead of the clock, and not before the prior map.
Stamp NewStamp(const MapProblem& problem,
               const std::optional<MapContent>& prior,
               const MapperOptions& options) {
  Stamp end = problem.runs.front().data->end();
  for (const BuildRun& run : problem.runs) end = std::max(end, run.data->end());
  if (options.now) end = std::min(end, *options.now);
  return prior ? std::max(end, prior->stamp) : end;
}

// Joint and marginal covariances of the map's modes.
// @param place  Of every mode of the problem, flat, its index in the map, or kNoPlace.
// @param modes  Of the map.
void SetCovariance(const JointCovariance& cov,
                   const std::vector<int>& place,
                   int modes,
                   MapContent* content) {
  std::vector<Eigen::Matrix2d> diagonal(static_cast<std::size_t>(modes));
  for (std::size_t i = 0; i < place.size(); ++i) {
    const auto flat = static_cast<int>(i);
    if (place[i] != kNoPlace) {
      diagonal[static_cast<std::size_t>(place[i])] = cov.Block(flat, flat);
    }
  }
  std::vector<JointCovariance::CrossBlock> cross;
  for (JointCovariance::CrossBlock block : cov.cross_blocks()) {
    block.row = place[static_cast<std::size_t>(block.row)];
    block.column = place[static_cast<std::size_t>(block.column)];
    if (block.row == kNoPlace || block.column == kNoPlace) continue;
    if (block.row > block.column) {
      std::swap(block.row, block.column);
      block.value.transposeInPlace();
    }
    cross.push_back(block);
  }
  content->covariance = JointCovariance(std::move(diagonal), std::move(cross));
  int index = 0;
  for (LandmarkGroup& group : content->groups) {
    for (Mode& mode : group.modes) {
      mode.cov_p_map_landmark = content->covariance.Block(index, index);
      ++index;
    }
  }
}

// Adds what runs found that has no signature: every position of a track is a landmark by itself, as
// a landmark without identity is nothing but its position.
// @param flat, cov  The problem's modes and their joint covariance.
void AddTracks(const MapProblem& problem,
               const std::vector<Signature>& signatures,
               const std::vector<std::vector<VisitRef>>& visits,
               const FlatModes& flat,
               const JointCovariance& cov,
               const MapperOptions& options,
               std::vector<Mode>* landmarks) {
  std::vector<std::vector<Mode>> found(problem.runs.size());
  for (std::size_t g = 0; g < problem.modes.size(); ++g) {
    if (!IsTrackSignature(signatures[g]) || visits[g].empty()) continue;
    for (std::size_t k = 0; k < problem.modes[g].size(); ++k) {
      const int index = flat.Index(static_cast<int>(g), static_cast<int>(k));
      Mode mode;
      mode.p_map_landmark = problem.modes[g][k].p_map_landmark;
      mode.cov_p_map_landmark = cov.Block(index, index);
      mode.last_seen = LastSeen(problem, visits[g], static_cast<int>(k), Stamp());
      found[static_cast<std::size_t>(visits[g].front().run)].push_back(mode);
    }
  }
  const AnonymousMergeOptions merge{options.association.compatibility.gate_probability,
                                    options.association.twin_distance_m,
                                    options.modes.position_floor_m};
  for (const std::vector<Mode>& of_run : found) AddAnonymousLandmarks(of_run, merge, landmarks);
}

}  // namespace

StatusOr<MapOutput> MakeMapContent(const MapProblem& problem,
                                   const std::vector<Signature>& signatures,
                                   const std::optional<MapContent>& prior,
                                   const JointCovariance& mode_covariance,
                                   const MapperOptions& options) {
  MapOutput output;
  MapContent& content = output.content;
  content.stamp = NewStamp(problem, prior, options);
  content.calibration = {FleetOdometry(problem.runs, options.calibration.odometry), problem.sensor};
  if (options.calibrate) {
    content.calibration.sensor = FleetSensor(problem, options.sd_range_scale);
  }
  if (prior) content.anonymous_landmarks = prior->anonymous_landmarks;

  const FlatModes flat(problem);
  std::vector<std::vector<VisitRef>> visits = VisitsByGroup(problem);
  const bool tracks = options.association.associate;
  if (tracks) {
    AddTracks(
        problem, signatures, visits, flat, mode_covariance, options, &content.anonymous_landmarks);
  }
  const std::vector<std::vector<MissedVisit>> missed =
      FindMissedVisits(problem, options.front_end.visit_gap_s, options.missed);
  std::vector<GroupSource> sources;
  std::vector<int> place(static_cast<std::size_t>(flat.count), kNoPlace);
  int modes = 0;
  for (std::size_t g = 0; g < problem.modes.size(); ++g) {
    if (problem.modes[g].empty() || (tracks && IsTrackSignature(signatures[g]))) continue;
    sources.push_back(
        {g, ModeOrder(problem, visits[g], problem.modes[g]), std::move(visits[g]), {}});
    sources.back().evidence = EvidenceOf(problem, sources.back(), missed[g], options.modes);
    content.groups.push_back(MakeGroup(problem, signatures, sources.back(), prior, options.modes));
    for (const std::size_t k : sources.back().order) {
      place[static_cast<std::size_t>(flat.Index(static_cast<int>(g), static_cast<int>(k)))] =
          modes++;
    }
  }
  // Landmarks that never leave a mode have no rate to learn.
  if (options.chains.learn && options.modes.leave_rate_per_s > 0.0) {
    SHIFTMAP_ASSIGN_OR_RETURN(output.chains,
                              LearnChainsOf(problem, sources, prior, options, &content.groups));
  }
  for (std::size_t i = 0; i < sources.size(); ++i) {
    SetProbabilities(problem, sources[i], prior, content.stamp, &content.groups[i]);
  }
  SetCovariance(mode_covariance, place, modes, &content);
  return output;
}

}  // namespace shiftmap
