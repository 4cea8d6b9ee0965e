// SPDX-License-Identifier: Apache-2.0
#include "tests/property/store_model.h"

#include <fmt/format.h>

#include <algorithm>
#include <tuple>
#include <utility>

#include "mapstore/map/mode_filter.h"

namespace shiftmap::testing {
namespace {

// What another version's content says of a group's states; nothing if it does not have the group.
std::optional<Eigen::VectorXd> Claim(const LandmarkGroup& group, const MapContent& content) {
  for (const LandmarkGroup& other : content.groups) {
    if (other.signature != group.signature) continue;
    Eigen::VectorXd claim = Eigen::VectorXd::Zero(group.chain.states());
    for (int state = 0; state < group.chain.states(); ++state) {
      bool named = false;
      for (int k = 0; k < other.chain.states(); ++k) {
        if (group.CarriedStateOf(other.NumberOf(k)) != state) continue;
        claim(state) += other.probabilities(k);
        named = true;
      }
      if (!named) claim(state) = other.probabilities(0);
    }
    return claim;
  }
  return std::nullopt;
}

std::size_t IndexOf(VersionNumber version) { return static_cast<std::size_t>(version.value() - 1); }

}  // namespace

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

bool StoreModel::IsOfLine(std::size_t other, std::size_t version) const {
  return IsInLine(other, version) || IsAncestor(version, other);
}

bool StoreModel::IsSuperseded(std::size_t report, std::size_t version) const {
  const ShiftReport& mine = reports_[report];
  return !mine.run_hash.empty() &&
         std::any_of(reports_.begin(), reports_.end(), [&](const ShiftReport& other) {
           const bool copy = !other.run_hash.empty() && other.begin == mine.begin &&
                             !other.evidence.empty() && !mine.evidence.empty();
           return (copy || other.run_hash == mine.run_hash) && other.vehicle == mine.vehicle &&
                  IsOfLine(IndexOf(other.version), version) &&
                  !IsExcluded(other.run_hash, other.vehicle, other.begin) &&
                  std::tie(mine.end, other.version, other.uuid) <
                      std::tie(other.end, mine.version, mine.uuid);
         });
}

bool StoreModel::IsExcluded(const std::string& run, const std::string& vehicle, Stamp begin) const {
  return std::any_of(exclusions_.begin(), exclusions_.end(), [&](const Exclusion& exclusion) {
    return exclusion.vehicle.empty() ? exclusion.run == run
                                     : exclusion.vehicle == vehicle && exclusion.since <= begin;
  });
}

bool StoreModel::IsInLine(std::size_t upper, std::size_t version) const {
  return upper == version || IsAncestor(upper, version);
}

std::optional<std::size_t> StoreModel::StatementOf(std::size_t version) const {
  std::optional<std::size_t> at = version;
  while (at && !versions_[*at].states) at = versions_[*at].parent;
  return at;
}

bool StoreModel::Counts(std::size_t report, const VisitEvidence& visit, std::size_t version) const {
  const std::optional<std::size_t> statement = StatementOf(version);
  const bool known = statement && report < versions_[*statement].reports_known;
  const ShiftReport& mine = reports_[report];
  if (IsExcluded(mine.run_hash.empty() ? mine.uuid : mine.run_hash, mine.vehicle, mine.begin)) {
    return false;
  }
  if (IsSuperseded(report, version)) return false;
  for (std::size_t built = 0; built < versions_.size(); ++built) {
    if (!IsInLine(built, version)) continue;
    if (known && IsInLine(built, *statement)) continue;
    for (const RunRecord& run : versions_[built].runs) {
      const bool copy =
          !mine.run_hash.empty() && run.vehicle == mine.vehicle && run.begin == mine.begin;
      if (copy || run.sha256 == mine.run_hash) return false;
    }
  }
  const std::size_t reported = IndexOf(reports_[report].version);
  if (!IsInLine(reported, version)) return IsAncestor(version, reported);
  return !(known && IsAncestor(reported, *statement) &&
           visit.begin <= versions_[*statement].content.stamp);
}

std::vector<EvidenceRow> StoreModel::RowsOf(const LandmarkGroup& group,
                                            std::size_t version,
                                            Stamp at) const {
  std::vector<EvidenceRow> rows;
  const auto add =
      [&](const std::string& source, const VisitEvidence& visit, const std::string& vehicle) {
        if (visit.signature == group.signature) rows.push_back({source, visit, vehicle});
      };
  for (std::size_t i = 0; i < reports_.size(); ++i) {
    for (const VisitEvidence& visit : reports_[i].evidence) {
      if (visit.begin <= at && Counts(i, visit, version)) {
        add(reports_[i].uuid, visit, reports_[i].vehicle);
      }
    }
  }
  const std::optional<std::size_t> statement = StatementOf(version);
  for (std::size_t built = 0; built < versions_.size(); ++built) {
    if (!IsInLine(built, version) || (statement && IsInLine(built, *statement))) continue;
    for (const RunRecord& run : versions_[built].runs) {
      if (IsExcluded(run.sha256, run.vehicle, run.begin)) continue;
      for (const VisitEvidence& visit : run.evidence) {
        if (visit.begin <= std::max(at, versions_[version].content.stamp)) {
          add(run.sha256, visit, run.vehicle);
        }
      }
    }
  }
  return rows;
}

std::vector<Eigen::VectorXd> StoreModel::ProbabilitiesAt(std::size_t version, Stamp at) const {
  const Stamp end = std::max(at, versions_[version].content.stamp);
  const std::vector<LandmarkGroup>& groups = versions_[version].content.groups;
  std::vector<std::pair<EvidenceRow, std::size_t>> rows;  // With its group.
  for (std::size_t g = 0; g < groups.size(); ++g) {
    for (EvidenceRow& row : InOrder(RowsOf(groups[g], version, at))) {
      rows.emplace_back(std::move(row), g);
    }
  }
  const auto key = [](const auto& of) {
    const EvidenceRow& row = of.first;
    return std::tie(row.evidence.begin, row.evidence.end, row.vehicle, row.source, of.second);
  };
  std::sort(
      rows.begin(), rows.end(), [&](const auto& a, const auto& b) { return key(a) < key(b); });

  std::vector<ModeState> states;
  for (const LandmarkGroup& group : groups) states.push_back(StationaryStart(group, at));
  VehicleRecords records;
  const std::optional<std::size_t> statement = StatementOf(version);
  bool stated = false;
  const auto take_statement = [&] {
    stated = true;
    const MapContent& content = versions_[*statement].content;
    for (std::size_t g = 0; g < groups.size(); ++g) {
      const auto claim = Claim(groups[g], content);
      if (claim) AddStatement(groups[g], *claim, content.stamp, records, &states[g]);
    }
  };
  Eigen::VectorXd log_likelihoods;
  for (const auto& [row, g] : rows) {
    const VisitEvidence& visit = row.evidence;
    const bool after = statement && visit.begin >= versions_[*statement].content.stamp;
    if (after && !stated) take_statement();
    if (!StateLogLikelihoods(groups[g], visit.modes, &log_likelihoods)) continue;
    const auto verdict = AddVisit(groups[g],
                                  visit.begin,
                                  visit.end,
                                  VehicleKey(row.vehicle),
                                  records,
                                  log_likelihoods,
                                  &states[g]);
    if (verdict) records.Add(*verdict);
  }
  if (statement && !stated) take_statement();
  std::vector<Eigen::VectorXd> probabilities;
  for (std::size_t g = 0; g < groups.size(); ++g) {
    probabilities.push_back(shiftmap::ProbabilitiesAt(groups[g], states[g], end, records));
  }
  return probabilities;
}

}  // namespace shiftmap::testing
