// SPDX-License-Identifier: Apache-2.0
#include "mapper/map_output.h"

#include <algorithm>
#include <iterator>
#include <map>
#include <utility>

#include "mapper/association/anonymous_landmarks.h"
#include "mapper/association/track_names.h"
#include "mapper/calibration/fleet_calibration.h"
#include "mapper/modes/doubtful_modes.h"
#include "mapper/modes/missed_visits.h"
#include "mapper/modes/mode_refinement.h"
#include "mapper/modes/unseen_modes.h"
#include "mapstore/map/mode_filter.h"
#include "mapstore/map/shift_report_check.h"

namespace shiftmap {
namespace {

// A mode of the build that is none of the map's: it has no signature.
constexpr int kNoPlace = -1;

// The states of a group of the build, `absent` first, in the order of the map's modes.
std::vector<int> StatesInOrder(const std::vector<GroupModeIndex>& mode_order) {
  std::vector<int> states = {0};
  for (const GroupModeIndex mode : mode_order) states.push_back(StateOf(mode));
  return states;
}

// Modes of a group in the order they get: the prior's by number, then new ones by first visit.
std::vector<GroupModeIndex> ModeOrder(const BuildState& build,
                                      const std::vector<VisitRef>& visits,
                                      const GroupModes& modes) {
  IndexedVector<GroupModeIndex, std::size_t> first_visit(modes.size(), visits.size());
  for (std::size_t v = visits.size(); v-- > 0;) {
    if (const OptionalMode mode = AssignmentOf(build, visits[v])) first_visit[*mode] = v;
  }
  std::vector<GroupModeIndex> order;
  for (const GroupModeIndex mode : modes.indices()) order.push_back(mode);
  std::stable_sort(order.begin(), order.end(), [&](GroupModeIndex a, GroupModeIndex b) {
    const bool a_known = modes[a].number != kAbsent;
    const bool b_known = modes[b].number != kAbsent;
    if (a_known != b_known) return a_known;
    return a_known ? modes[a].number < modes[b].number : first_visit[a] < first_visit[b];
  });
  return order;
}

Stamp LastSeen(const BuildState& build,
               const std::vector<VisitRef>& visits,
               GroupModeIndex mode,
               Stamp known) {
  for (const VisitRef& ref : visits) {
    if (AssignmentOf(build, ref) == mode) known = std::max(known, VisitOf(build, ref).end);
  }
  return known;
}

// What a visit of this build says of a group of the map.
struct BuildVisit {
  RunIndex run;
  VisitEvidence evidence;
};

// A group of the map and where it comes from.
struct GroupSource {
  GroupIndex group;                   // In the build.
  std::vector<GroupModeIndex> order;  // The build's modes in the order of the map's.
  std::vector<VisitRef> visits;       // In the order of time.
  std::vector<BuildVisit> evidence;   // In the order of time, that without sightings included.
};

// Log-likelihoods as the ledger takes them: one visit says no more than kMaxVisitLogRatio.
VisitEvidence MakeEvidence(const LandmarkGroup& group,
                           Stamp begin,
                           Stamp end,
                           const Eigen::VectorXd& log_likelihoods) {
  VisitEvidence evidence{group.signature, begin, end, {}, 0};
  const double least = log_likelihoods.maxCoeff() - kMaxVisitLogRatio;
  for (int state = 0; state < group.chain.states(); ++state) {
    evidence.modes.push_back({group.NumberOf(state), std::max(log_likelihoods(state), least)});
  }
  return evidence;
}

std::vector<BuildVisit> EvidenceOf(const BuildState& build,
                                   const GroupSource& source,
                                   const LandmarkGroup& group,
                                   const std::vector<MissedVisit>& missed,
                                   const ModeOptions& options) {
  const std::vector<int> states = StatesInOrder(source.order);
  std::vector<BuildVisit> evidence;
  for (const VisitRef& ref : source.visits) {
    const MappingVisit& visit = VisitOf(build, ref);
    Eigen::VectorXd log_likelihoods = VisitLogLikelihood(build, ref, options);
    MixAlternatives(build, ref, &log_likelihoods);
    evidence.push_back(
        {ref.run, MakeEvidence(group, visit.begin, visit.end, log_likelihoods(states))});
    evidence.back().evidence.observations = std::ssize(visit.sightings);
  }
  for (const MissedVisit& visit : missed) {
    evidence.push_back(
        {visit.run, MakeEvidence(group, visit.begin, visit.end, visit.log_likelihoods(states))});
  }
  std::stable_sort(evidence.begin(), evidence.end(), [](const auto& a, const auto& b) {
    return a.evidence.begin < b.evidence.begin;
  });
  return evidence;
}

// The visibility of the build's modes in earlier runs. That of a merged mode belongs to the mode
// that stands for it.
IndexedVector<ModeIndex, Visibility> KnownVisibility(
    const BuildState& build,
    const IndexedVector<GroupIndex, Signature>& signatures,
    const FlatModes& flat,
    const std::vector<ModeVisibility>& visibility) {
  IndexedVector<ModeIndex, Visibility> known(flat.count());
  for (const ModeVisibility& of_mode : visibility) {
    const auto signature =
        std::lower_bound(signatures.begin(), signatures.end(), of_mode.signature);
    if (signature == signatures.end() || *signature != of_mode.signature) continue;
    const GroupIndex g(signature - signatures.begin());
    const LandmarkGroup* const group = build.Known(g);
    const int state = group != nullptr ? group->CarriedStateOf(of_mode.mode) : -1;
    if (state <= 0) continue;
    const ModeNumber number = group->NumberOf(state);
    for (const GroupModeIndex k : build.modes[g].indices()) {
      if (build.modes[g][k].number == number) known[flat.Index(g, k)] += of_mode.scans;
    }
  }
  return known;
}

// How well each run saw the modes of the map.
IndexedVector<RunIndex, std::vector<ModeVisibility>> VisibilityByRun(
    const IndexedVector<RunIndex, std::vector<SeenMode>>& seen_by_run,
    const std::vector<GroupSource>& sources,
    const std::vector<LandmarkGroup>& groups) {
  std::map<BuildModeRef, std::pair<std::size_t, ModeNumber>> numbers;  // Group of the map, mode.
  for (std::size_t i = 0; i < sources.size(); ++i) {
    for (std::size_t k = 0; k < sources[i].order.size(); ++k) {
      numbers[{sources[i].group, sources[i].order[k]}] = {i, groups[i].modes[k].number};
    }
  }
  IndexedVector<RunIndex, std::vector<ModeVisibility>> by_run(seen_by_run.size());
  for (const RunIndex run : seen_by_run.indices()) {
    for (const SeenMode& seen : seen_by_run[run]) {
      const auto number = numbers.find(seen.mode);
      if (number == numbers.end()) continue;
      const auto& [group, mode] = number->second;
      by_run[run].push_back({groups[group].signature, mode, seen.scans});
    }
  }
  return by_run;
}

// A group of the map without probabilities, its chain as the prior map has it.
LandmarkGroup MakeGroup(const BuildState& build,
                        const IndexedVector<GroupIndex, Signature>& signatures,
                        const GroupSource& source,
                        const ModeOptions& options) {
  const GroupModes& modes = build.modes[source.group];
  const LandmarkGroup* known = build.Known(source.group);
  LandmarkGroup group;
  group.signature = signatures[source.group];
  group.chain = ChainOf(build, source.group, options);
  if (known != nullptr) group.merged = known->merged;
  ModeNumber next = known != nullptr ? known->NextNumber() : ModeNumber(1);
  for (const GroupModeIndex k : source.order) {
    const int known_state =
        known != nullptr && modes[k].number != kAbsent ? known->StateOf(modes[k].number) : 0;
    Mode mode;
    mode.number = known_state > 0 ? modes[k].number : next;
    if (known_state <= 0) next = ModeNumber(next.value() + 1);
    mode.p_map_landmark = modes[k].p_map_landmark;
    const Stamp known_last = known_state > 0
                                 ? known->modes[static_cast<std::size_t>(known_state) - 1].last_seen
                                 : Stamp();
    mode.last_seen = LastSeen(build, source.visits, k, known_last);
    group.modes.push_back(mode);
  }
  return group;
}

// The modes of the map that the prior map does not have.
// @param sources     Of the groups.
// @param visibility  By run of the build.
std::vector<NewMode> NewModes(
    const BuildState& build,
    const std::vector<GroupSource>& sources,
    const std::vector<LandmarkGroup>& groups,
    const IndexedVector<RunIndex, std::vector<ModeVisibility>>& visibility) {
  std::map<std::pair<Signature, ModeNumber>, Visibility> scans;
  for (const std::vector<ModeVisibility>& of_run : visibility) {
    for (const ModeVisibility& of_mode : of_run) {
      scans[{of_mode.signature, of_mode.mode}] += of_mode.scans;
    }
  }
  std::vector<NewMode> modes;
  for (std::size_t i = 0; i < groups.size(); ++i) {
    const LandmarkGroup& group = groups[i];
    const LandmarkGroup* const before = build.Known(sources[i].group);
    for (const Mode& mode : group.modes) {
      if (before != nullptr && before->StateOf(mode.number) > 0) continue;
      modes.push_back({group.signature,
                       mode.number,
                       mode.p_map_landmark,
                       scans[{group.signature, mode.number}]});
    }
  }
  return modes;
}

// This build's evidence of a group as rows of the ledger.
std::vector<EvidenceRow> RowsOf(const BuildState& build, const GroupSource& source) {
  std::vector<EvidenceRow> rows;
  for (const BuildVisit& visit : source.evidence) {
    const MappingRun& run = *build.runs[visit.run].data;
    rows.push_back({run.sha256, visit.evidence, run.info.vehicle});
  }
  return rows;
}

// Gives the groups the chains that the ledger and this build's visits support. A known group of
// which neither has visits keeps its chain.
StatusOr<std::vector<GroupChain>> LearnChainsOf(const BuildState& build,
                                                const std::vector<GroupSource>& sources,
                                                const std::vector<RunRecord>& older,
                                                const MapperOptions& options,
                                                std::vector<LandmarkGroup>* groups) {
  std::vector<EvidenceRow> rows;
  for (const GroupSource& source : sources) {
    for (EvidenceRow& row : RowsOf(build, source)) rows.push_back(std::move(row));
  }
  for (const RunRecord& run : older) {
    for (const VisitEvidence& visit : run.evidence) {
      rows.push_back({run.sha256, visit, run.vehicle});
    }
  }
  const auto known = [&](std::size_t i) { return build.Known(sources[i].group) != nullptr; };
  return LearnChains(std::move(rows), options, known, groups);
}

// The filter of the group's chain over its visits, as the map's readers filter theirs: T-IV (13,
// 14). The prior map's probabilities enter as a statement at its stamp.
void SetProbabilities(const BuildState& build,
                      const GroupSource& source,
                      Stamp end,
                      LandmarkGroup* group) {
  std::vector<EvidenceRow> older = RowsOf(build, source);
  std::vector<EvidenceRow> newer;
  ModeState state = StationaryStart(*group, build.runs.front().data->begin);
  const LandmarkGroup* known = build.Known(source.group);
  if (known != nullptr) {
    const auto first_newer = std::find_if(older.begin(), older.end(), [&](const EvidenceRow& row) {
      return row.evidence.begin >= build.known_at;
    });
    newer.assign(first_newer, older.end());
    older.erase(first_newer, older.end());
  }
  state = FilterModes(*group, std::move(state), std::move(older));
  if (known != nullptr) {
    std::vector<StatedMode> stated;
    for (int i = 0; i < known->chain.states(); ++i) {
      stated.push_back({known->NumberOf(i), known->probabilities(i)});
    }
    AddStatement(*group, CarriedProbabilities(*group, stated), build.known_at, {}, &state);
    state = FilterModes(*group, std::move(state), std::move(newer));
  }
  group->probabilities = ProbabilitiesAt(*group, state, end);
}

// The end of the newest run, but not ahead of the clock, and not before the prior map.
Stamp NewStamp(const BuildState& build,
               const std::optional<MapContent>& prior,
               const MapperOptions& options) {
  Stamp end = build.runs.front().data->end;
  for (const BuildRun& run : build.runs) end = std::max(end, run.data->end);
  if (options.now) end = std::min(end, *options.now);
  return prior ? std::max(end, prior->stamp) : end;
}

// Joint and marginal covariances of the map's modes.
// @param place  Of every mode of the build its index in the map, or kNoPlace.
// @param modes  Of the map.
void SetCovariance(const JointCovariance& cov,
                   const IndexedVector<ModeIndex, int>& place,
                   int modes,
                   MapContent* content) {
  std::vector<Eigen::Matrix2d> diagonal(static_cast<std::size_t>(modes));
  for (const ModeIndex i : place.indices()) {
    if (place[i] != kNoPlace) {
      diagonal[static_cast<std::size_t>(place[i])] = cov.Block(i.value(), i.value());
    }
  }
  std::vector<JointCovariance::CrossBlock> cross;
  for (JointCovariance::CrossBlock block : cov.cross_blocks()) {
    block.row = place[ModeIndex(block.row)];
    block.column = place[ModeIndex(block.column)];
    if (block.row == kNoPlace || block.column == kNoPlace) continue;
    if (block.row > block.column) {
      std::swap(block.row, block.column);
      block.value.transposeInPlace();
    }
    cross.push_back(block);
  }
  content->covariance = JointCovariance(std::move(diagonal), std::move(cross));
  SetMarginals(content);
}

// Adds what runs found that has no signature: every position of a track is a landmark by itself, as
// a landmark without identity is nothing but its position.
// @param flat, cov  The build's modes and their joint covariance.
void AddTracks(const BuildState& build,
               const IndexedVector<GroupIndex, Signature>& signatures,
               const IndexedVector<GroupIndex, std::vector<VisitRef>>& visits,
               const FlatModes& flat,
               const JointCovariance& cov,
               const MapperOptions& options,
               std::vector<Mode>* landmarks) {
  IndexedVector<RunIndex, std::vector<Mode>> found(build.runs.size());
  for (const GroupIndex g : build.modes.indices()) {
    if (!IsTrackSignature(signatures[g]) || visits[g].empty()) continue;
    for (const GroupModeIndex k : build.modes[g].indices()) {
      const int index = flat.Index(g, k).value();
      Mode mode;
      mode.p_map_landmark = build.modes[g][k].p_map_landmark;
      mode.cov_p_map_landmark = cov.Block(index, index);
      mode.last_seen = LastSeen(build, visits[g], k, Stamp());
      found[visits[g].front().run].push_back(mode);
    }
  }
  const AnonymousMergeOptions merge{options.association.compatibility.gate_probability,
                                    options.association.duplicate_distance_m,
                                    options.modes.position_floor_m};
  for (const std::vector<Mode>& of_run : found) AddAnonymousLandmarks(of_run, merge, landmarks);
}

}  // namespace

StatusOr<std::vector<GroupChain>> LearnChains(std::vector<EvidenceRow> rows,
                                              const MapperOptions& options,
                                              const std::function<bool(std::size_t)>& has_own,
                                              std::vector<LandmarkGroup>* groups) {
  std::vector<EvidenceRow> evidence = options.chains.ledger;
  std::move(rows.begin(), rows.end(), std::back_inserter(evidence));
  GroupChainOptions learning = options.chains.learning;
  learning.leave_rate_per_s = options.modes.leave_rate_per_s;
  learning.threads = options.threads;
  SHIFTMAP_ASSIGN_OR_RETURN(std::vector<GroupChain> chains,
                            LearnGroupChains(*groups, evidence, learning));
  for (std::size_t i = 0; i < chains.size(); ++i) {
    LandmarkGroup& group = (*groups)[i];
    const bool relearned = options.chains.relearned.contains(group.signature);
    if (chains[i].learned || !has_own(i) || relearned) group.chain = chains[i].chain.chain;
  }
  return chains;
}

void SetMarginals(MapContent* content) {
  int index = 0;
  for (LandmarkGroup& group : content->groups) {
    for (Mode& mode : group.modes) {
      mode.cov_p_map_landmark = content->covariance.Block(index, index);
      ++index;
    }
  }
}

StatusOr<MapOutput> MakeMapContent(const BuildState& build,
                                   const IndexedVector<GroupIndex, Signature>& signatures,
                                   const std::optional<MapContent>& prior,
                                   const JointCovariance& mode_covariance,
                                   const MapperOptions& options) {
  MapOutput output;
  MapContent& content = output.content;
  content.stamp = NewStamp(build, prior, options);
  content.calibration = {FleetOdometry(build.runs, options.calibration.odometry), build.sensor};
  if (options.calibrate) {
    content.calibration.sensor = FleetSensor(build, options.sd_range_scale);
  }
  if (prior) content.anonymous_landmarks = prior->anonymous_landmarks;

  const FlatModes flat(build);
  auto visits = VisitsByGroup(build);
  const bool tracks = options.association.associate;
  if (tracks) {
    AddTracks(
        build, signatures, visits, flat, mode_covariance, options, &content.anonymous_landmarks);
  }
  const MissedVisits missed =
      FindMissedVisits(build,
                       options.front_end.visit_gap_s,
                       options.missed,
                       KnownVisibility(build, signatures, flat, options.visibility));
  std::vector<GroupSource> sources;
  IndexedVector<ModeIndex, int> place(flat.count(), kNoPlace);
  int modes = 0;
  for (const GroupIndex g : build.modes.indices()) {
    if (build.modes[g].empty() || (tracks && IsTrackSignature(signatures[g]))) continue;
    sources.push_back({g, ModeOrder(build, visits[g], build.modes[g]), std::move(visits[g]), {}});
    content.groups.push_back(MakeGroup(build, signatures, sources.back(), options.modes));
    sources.back().evidence =
        EvidenceOf(build, sources.back(), content.groups.back(), missed.by_group[g], options.modes);
    for (const GroupModeIndex k : sources.back().order) place[flat.Index(g, k)] = modes++;
  }
  output.visibility = VisibilityByRun(missed.seen_by_run, sources, content.groups);
  output.older = FindUnseenModes(options.older_runs,
                                 NewModes(build, sources, content.groups, output.visibility),
                                 options.chains.ledger,
                                 options.front_end.visit_gap_s,
                                 build.sensor,
                                 options.missed);
  // Landmarks that never leave a mode have no rate to learn.
  if (options.chains.learn && options.modes.leave_rate_per_s > 0.0) {
    SHIFTMAP_ASSIGN_OR_RETURN(
        output.chains, LearnChainsOf(build, sources, output.older, options, &content.groups));
  }
  for (std::size_t i = 0; i < sources.size(); ++i) {
    SetProbabilities(build, sources[i], content.stamp, &content.groups[i]);
  }
  output.evidence.resize(build.runs.size());
  for (GroupSource& source : sources) {
    for (BuildVisit& visit : source.evidence) {
      output.evidence[visit.run].push_back(std::move(visit.evidence));
    }
  }
  SetCovariance(mode_covariance, place, modes, &content);
  return output;
}

}  // namespace shiftmap
