// SPDX-License-Identifier: Apache-2.0
#include "tools/inspect/landmark_history.h"

#include <algorithm>
#include <map>
#include <set>
#include <utility>

#include "mapstore/geometry/covariance.h"
#include "mapstore/map/move_rate.h"

namespace shiftmap {
namespace {

std::vector<ModeProbability> Numbered(const LandmarkGroup& group,
                                      const Eigen::VectorXd& probabilities) {
  std::vector<ModeProbability> modes;
  modes.reserve(static_cast<std::size_t>(probabilities.size()));
  for (Eigen::Index state = 0; state < probabilities.size(); ++state) {
    modes.push_back({group.NumberOf(static_cast<int>(state)), probabilities(state)});
  }
  return modes;
}

// The mode that stands for a number in the group.
std::optional<ModeNumber> Carried(const std::optional<LandmarkGroup>& group, ModeNumber number) {
  if (!group) return std::nullopt;
  const int state = group->CarriedStateOf(number);
  return state < 0 ? std::nullopt : std::optional(group->NumberOf(state));
}

// The most likely mode of a row, and the log-odds against the next one.
void SetLikelyMode(HistoryVisit* visit) {
  std::vector<VisitEvidence::ModeLogLikelihood> modes = visit->log_likelihoods;
  std::stable_sort(modes.begin(), modes.end(), [](const auto& a, const auto& b) {
    return a.log_likelihood > b.log_likelihood;
  });
  if (modes.empty()) return;
  visit->likely_mode = modes.front().mode;
  if (modes.size() > 1) visit->log_odds = modes[0].log_likelihood - modes[1].log_likelihood;
}

bool Moved(const ModePosition& from, const Mode& to) {
  return SquaredMahalanobis(to.p_map_landmark - from.p_map_landmark,
                            to.cov_p_map_landmark + from.cov_p_map_landmark) >
         kMovedSquaredMahalanobis;
}

// The modes of the line, from its oldest version to its newest.
std::vector<ModeHistory> ModesOf(const LandmarkRecords& records) {
  std::map<ModeNumber, ModeHistory> modes;
  for (const LandmarkInVersion& version : records.versions) {
    if (!version.in_line) continue;
    for (const Mode& mode : version.modes) {
      const ModePosition position{version.version, mode.p_map_landmark, mode.cov_p_map_landmark};
      const auto [found, is_new] = modes.try_emplace(mode.number);
      ModeHistory& history = found->second;
      if (is_new) {
        history.number = mode.number;
        history.first_version = version.version;
        history.or_before =
            version.parent && std::none_of(records.versions.begin(),
                                           records.versions.end(),
                                           [&](const LandmarkInVersion& other) {
                                             return other.version == *version.parent;
                                           });
      }
      if (is_new || Moved(history.positions.back(), mode)) history.positions.push_back(position);
      history.position = position;
      history.last_seen = mode.last_seen;
    }
  }
  std::vector<ModeHistory> list;
  for (auto& [number, history] : modes) {
    const int state = records.group ? records.group->StateOf(number) : -1;
    history.gone = state < 0;
    if (state >= 0) {
      history.probability = records.group->probabilities(state);
    } else if (const auto carried = Carried(records.group, number)) {
      history.merged_into = carried;
    }
    list.push_back(std::move(history));
  }
  return list;
}

HistoryVisit VisitOf(const LandmarkVisit& row, const std::optional<LandmarkGroup>& group) {
  HistoryVisit visit;
  visit.begin = row.evidence.begin;
  visit.end = row.evidence.end;
  visit.vehicle = row.vehicle;
  visit.run = row.run;
  visit.run_name = row.run_name;
  visit.mapped = row.mapped();
  visit.report = row.report;
  visit.version = row.version;
  visit.arrived = row.arrived;
  visit.observations = row.evidence.observations;
  visit.log_likelihoods = row.evidence.modes;
  SetLikelyMode(&visit);
  visit.current_mode = Carried(group, visit.likely_mode);
  visit.decision = row.decision;
  visit.set_aside = row.set_aside;
  if (group) visit.probabilities = Numbered(*group, row.probabilities);
  return visit;
}

// Connects the visits and the modes that they saw.
void Connect(std::vector<HistoryVisit>* visits, std::vector<ModeHistory>* modes) {
  for (std::size_t i = 0; i < visits->size(); ++i) {
    HistoryVisit& visit = (*visits)[i];
    const auto mode = std::find_if(modes->begin(), modes->end(), [&](const ModeHistory& other) {
      return visit.current_mode == other.number;
    });
    if (mode == modes->end()) continue;
    visit.known_since = mode->first_version;
    visit.or_before = mode->or_before;
    if (visit.set_aside || visit.observations == 0) continue;
    ++mode->visits;
    if (!mode->first_visit) mode->first_visit = i;
    mode->last_visit = i;
  }
}

}  // namespace

StatusOr<LandmarkHistory> LoadLandmarkHistory(MapStore* store,
                                              const std::string& area,
                                              const Signature& signature,
                                              const HistoryOptions& options) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      const LandmarkRecords records,
      store->LoadLandmark(
          area,
          signature,
          {options.version, options.at, options.known, options.track, options.choose_track}));
  LandmarkHistory history;
  history.area = area;
  history.signature = records.signature;
  history.version = records.version;
  history.stamp = records.stamp;
  history.known = options.known;
  history.in_version = records.group.has_value();
  history.modes = ModesOf(records);
  if (records.group) {
    history.probabilities = Numbered(*records.group, records.group->probabilities);
    history.move_rate_per_s = MoveRate(records.group->chain);
    if (records.statement) {
      history.statement = LandmarkHistory::Statement{
          records.statement->version,
          {records.statement->stamp, Numbered(*records.group, records.statement->probabilities)}};
    }
  }
  std::set<VersionNumber> mapped_by;
  for (const LandmarkVisit& row : records.visits) {
    if (row.mapped()) mapped_by.insert(row.version);
    history.visits.push_back(VisitOf(row, records.group));
  }
  Connect(&history.visits, &history.modes);
  history.mapped_by.assign(mapped_by.begin(), mapped_by.end());
  for (const LandmarkInVersion& version : records.versions) {
    if (version.known) history.versions.push_back(version.version);
  }
  for (std::size_t i = 0; i < records.track_times.size(); ++i) {
    ModeProbabilities at{records.track_times[i], {}};
    if (records.group) at.modes = Numbered(*records.group, records.track[i]);
    history.track.push_back(std::move(at));
  }
  return history;
}

}  // namespace shiftmap
