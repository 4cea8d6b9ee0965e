// SPDX-License-Identifier: Apache-2.0
#include "mapper/nightly/replay.h"

#include <algorithm>
#include <map>
#include <numeric>
#include <utility>

#include "localizer/localizer.h"

namespace shiftmap {
namespace {

constexpr std::int64_t kEventsBetweenQuestions = 4096;

// Fewer are a passing view.
constexpr int kMinSightings = 3;

double At(const ShiftScore& score, LocalizerState state) {
  return score.seconds_in_state[static_cast<std::size_t>(state)];
}

// The landmarks whose mode was decided, by the last decision about each.
void CountDecisions(const Localizer& localizer, const FoundModes& found, ShiftScore* score) {
  std::map<Signature, ModeNumber> decided;
  const MapSnapshot& map = localizer.snapshot();
  for (const Decision& decision : localizer.decisions()) {
    decided[decision.signature] = decision.mode;
  }
  score->decisions = static_cast<int>(decided.size());
  score->met = static_cast<int>(found.size());
  for (const auto& [signature, mode] : found) {
    const int index = map.GroupIndex(signature);
    if (index < 0) continue;
    const LandmarkGroup& group = map.groups()[static_cast<std::size_t>(index)];
    const auto of = decided.find(group.signature);
    if (of == decided.end()) continue;
    const int state = group.CarriedStateOf(mode);
    if (state >= 0 && state == group.StateOf(of->second)) ++score->right;
  }
}

}  // namespace

double ShiftScore::seconds() const {
  return std::accumulate(seconds_in_state.begin(), seconds_in_state.end(), 0.0);
}

double ShiftScore::ShareOf(LocalizerState state) const {
  const double all = seconds();
  return all > 0.0 ? At(*this, state) / all : 0.0;
}

double ShiftScore::lost_share() const {
  return ShareOf(LocalizerState::kInitializing) + ShareOf(LocalizerState::kLost);
}

double ShiftScore::ungated_share() const {
  constexpr std::int64_t kDof = 2;  // Of an observation.
  const std::int64_t seen = dof / kDof + ungated;
  return seen > 0 ? static_cast<double>(ungated) / static_cast<double>(seen) : 0.0;
}

double ShiftScore::wrong_share() const {
  return met > 0 ? 1.0 - std::min(1.0, static_cast<double>(right) / met) : 0.0;
}

double ShiftScore::doubt_share() const {
  return lost_share() + ShareOf(LocalizerState::kUnknownChange);
}

MapSnapshot WithContent(const MapSnapshot& map, MapContent content) {
  return {map.area(),
          map.version(),
          map.content_hash(),
          std::move(content),
          map.ledger_position(),
          map.aliases()};
}

MapSnapshot KnownBefore(const MapSnapshot& map, const std::vector<EvidenceRow>& rows, Stamp begin) {
  std::map<int, std::vector<EvidenceRow>> by_group;
  for (const EvidenceRow& row : rows) {
    const int group = map.GroupIndex(row.evidence.signature);
    if (group >= 0 && row.evidence.begin < begin) by_group[group].push_back(row);
  }
  MapContent content = map.content();
  for (std::size_t i = 0; i < content.groups.size(); ++i) {
    LandmarkGroup& group = content.groups[i];
    ModeState state = StationaryStart(group, begin);
    const auto found = by_group.find(static_cast<int>(i));
    if (found != by_group.end()) state = FilterModes(group, state, std::move(found->second));
    group.probabilities = ProbabilitiesAt(group, state, begin);
  }
  content.stamp = begin;
  return WithContent(map, std::move(content));
}

FoundModes FindModes(const std::vector<EvidenceRow>& rows, const std::string& run) {
  FoundModes found;
  std::map<Signature, Stamp> newest;
  for (const EvidenceRow& row : rows) {
    const VisitEvidence& visit = row.evidence;
    if (row.source != run || visit.observations < kMinSightings) continue;
    const auto [at, first] = newest.emplace(visit.signature, visit.begin);
    if (!first && visit.begin < at->second) continue;
    at->second = visit.begin;
    const auto likeliest =
        std::max_element(visit.modes.begin(), visit.modes.end(), [](const auto& a, const auto& b) {
          return a.log_likelihood < b.log_likelihood;
        });
    if (likeliest != visit.modes.end()) found[visit.signature] = likeliest->mode;
  }
  return found;
}

StatusOr<ShiftScore> Replay(const Run& run,
                            const MapSnapshot& map,
                            const FoundModes& found,
                            const std::function<Status()>& on_step) {
  Localizer localizer(map.ForVehicle(run.info.vehicle), LocalizerOptions());
  std::int64_t events = 0;
  const auto take = [&](const RunEvent& event) -> Status {
    if (++events % kEventsBetweenQuestions == 0) SHIFTMAP_RETURN_IF_ERROR(on_step());
    return localizer.Process(event);
  };
  SHIFTMAP_RETURN_IF_ERROR(ForEachEvent(run, take));
  localizer.Finish();
  const LocalizerStatistics statistics = localizer.Statistics();
  ShiftScore score;
  score.seconds_in_state = statistics.seconds_in_state;
  score.nis_sum = statistics.nis_sum;
  score.dof = 2 * statistics.updates;
  score.ungated = statistics.ungated;
  CountDecisions(localizer, found, &score);
  return score;
}

}  // namespace shiftmap
