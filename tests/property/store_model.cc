// SPDX-License-Identifier: Apache-2.0
#include "tests/property/store_model.h"

#include <algorithm>
#include <tuple>
#include <utility>

#include "mapstore/map/mode_filter.h"

namespace shiftmap::testing {

std::size_t StoreModel::Commit(Version version) {
  versions_.push_back(std::move(version));
  return versions_.size() - 1;
}

void StoreModel::Return(const ShiftReport& report) {
  if (!Knows(report.uuid)) reports_.push_back(report);
}

void StoreModel::Compact(std::size_t keep) {
  for (std::size_t i = 0; i < versions_.size(); ++i) {
    if (i + keep < versions_.size() && published_ != i) versions_[i].stored = false;
  }
}

bool StoreModel::Knows(const std::string& uuid) const {
  return std::any_of(reports_.begin(), reports_.end(), [&](const ShiftReport& report) {
    return report.uuid == uuid;
  });
}

bool StoreModel::IsAncestor(std::size_t ancestor, std::size_t version) const {
  for (std::optional<std::size_t> at = versions_[version].parent; at; at = versions_[*at].parent) {
    if (*at == ancestor) return true;
  }
  return false;
}

bool StoreModel::IsSuperseded(std::size_t report) const {
  const ShiftReport& mine = reports_[report];
  return !mine.run_hash.empty() &&
         std::any_of(reports_.begin(), reports_.end(), [&](const ShiftReport& other) {
           return other.run_hash == mine.run_hash &&
                  std::tie(other.version, other.uuid) < std::tie(mine.version, mine.uuid);
         });
}

StoreModel::Use StoreModel::UseOf(std::size_t report,
                                  const VisitEvidence& visit,
                                  std::size_t version) const {
  const auto reported = static_cast<std::size_t>(reports_[report].version.value() - 1);
  const bool known = report < versions_[version].reports_known;
  if (IsSuperseded(report)) return Use::kNot;
  for (std::size_t built = 0; built < versions_.size() && !known; ++built) {
    const std::vector<std::string>& runs = versions_[built].run_hashes;
    const bool has = std::find(runs.begin(), runs.end(), reports_[report].run_hash) != runs.end();
    if (has && (built == version || IsAncestor(built, version))) return Use::kNot;
  }
  if (reported == version || IsAncestor(version, reported)) return Use::kInOrder;
  if (!IsAncestor(reported, version)) return Use::kNot;
  if (visit.begin > versions_[version].content.stamp) return Use::kInOrder;
  return known ? Use::kNot : Use::kLate;
}

std::vector<Eigen::VectorXd> StoreModel::ProbabilitiesAt(std::size_t version, Stamp at) const {
  const MapContent& content = versions_[version].content;
  std::vector<Eigen::VectorXd> probabilities;
  for (const LandmarkGroup& group : content.groups) {
    std::vector<EvidenceRow> in_order;
    std::vector<EvidenceRow> late;
    for (std::size_t i = 0; i < reports_.size(); ++i) {
      for (const VisitEvidence& visit : reports_[i].evidence) {
        if (visit.signature != group.signature) continue;
        const Use use = UseOf(i, visit, version);
        if (use == Use::kInOrder && visit.begin <= at) {
          in_order.push_back({reports_[i].uuid, visit});
        } else if (use == Use::kLate) {
          late.push_back({reports_[i].uuid, visit});
        }
      }
    }
    ModeState state = StartModes(group, content.stamp);
    if (!late.empty()) {
      AddLateVisits(group, FilterModes(group, StationaryStart(group, content.stamp), late), &state);
    }
    state = FilterModes(group, state, in_order);
    probabilities.push_back(shiftmap::ProbabilitiesAt(group, state, at));
  }
  return probabilities;
}

}  // namespace shiftmap::testing
