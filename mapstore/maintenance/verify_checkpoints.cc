// SPDX-License-Identifier: Apache-2.0
#include <optional>
#include <tuple>
#include <vector>

#include "mapstore/maintenance/verify_rows.h"
#include "mapstore/store/checkpoint_rows.h"
#include "mapstore/store/ledger_filter.h"
#include "mapstore/store/version_rows.h"

namespace shiftmap {
namespace {

bool Same(const std::optional<VehicleTurn>& a, const std::optional<VehicleTurn>& b) {
  if (!a || !b) return a.has_value() == b.has_value();
  return a->vehicle == b->vehicle && a->log_bayes_factor == b->log_bayes_factor &&
         a->log_right == b->log_right && a->log_own == b->log_own && a->mistaken == b->mistaken;
}

bool Same(const LedgerStates& a, const LedgerStates& b) {
  if (a.newest_end != b.newest_end || a.groups.size() != b.groups.size() ||
      a.records != b.records) {
    return false;
  }
  for (std::size_t i = 0; i < a.groups.size(); ++i) {
    if (a.groups[i].has_value() != b.groups[i].has_value()) return false;
    if (!a.groups[i]) continue;
    const ModeState& left = *a.groups[i];
    const ModeState& right = *b.groups[i];
    if (left.stamp != right.stamp || left.started != right.started ||
        left.log_probabilities != right.log_probabilities || !Same(left.turn, right.turn)) {
      return false;
    }
  }
  return true;
}

// All checkpoints of one version, in one pass over the ledger.
Status VerifyVersion(Database& database,
                     std::int64_t area_id,
                     std::int64_t version_id,
                     DefectList* defects) {
  SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow version, GetVersionById(database, version_id));
  const std::string key = fmt::format("version row {}", version_id);
  if (!version.content_stored) {
    defects->Add("ledger_checkpoint", key, "of a version without content");
    return OkStatus();
  }
  // Content that is damaged was named before.
  const StatusOr<MapContent> content = ReadContent(database, version, key);
  if (!content.ok()) return OkStatus();
  std::vector<Stamp> times;
  {
    SHIFTMAP_ASSIGN_OR_RETURN(
        Statement query,
        database.Prepare("SELECT before_ns FROM ledger_checkpoint WHERE area_id = ?1 "
                         "AND version_id = ?2 ORDER BY before_ns"));
    query.Bind(area_id, version_id);
    for (;;) {
      SHIFTMAP_ASSIGN_OR_RETURN(const bool row, query.Step());
      if (!row) break;
      times.push_back(StampFromNanoseconds(query.Int64(0)));
    }
  }
  std::optional<LedgerFilter> filter;
  for (const Stamp before : times) {
    ++defects->result().checkpoints;
    const StatusOr<std::optional<Checkpoint>> stored =
        FindCheckpoint(database, area_id, version_id, before - Duration(1), *content);
    if (!stored.ok()) {
      defects->Add("ledger_checkpoint", key, Message(stored.status()));
      continue;
    }
    if (!(*stored)->rows_stored) continue;  // What it was made from is elsewhere.
    if (!filter) filter.emplace(database, area_id, version, *content);
    SHIFTMAP_RETURN_IF_ERROR(filter->AdvanceTo(before).status());
    if (!Same(filter->states(), (*stored)->states)) {
      defects->Add("ledger_checkpoint",
                   fmt::format("{}, before {} ns", key, ToNanoseconds(before)),
                   "is not what the ledger gives");
    }
  }
  return OkStatus();
}

}  // namespace

Status VerifyCheckpoints(Database& database, DefectList* defects) {
  std::vector<std::tuple<std::int64_t, std::int64_t>> versions;
  {
    SHIFTMAP_ASSIGN_OR_RETURN(
        Statement query,
        database.Prepare("SELECT DISTINCT area_id, version_id FROM ledger_checkpoint"));
    query.Bind();
    for (;;) {
      SHIFTMAP_ASSIGN_OR_RETURN(const bool row, query.Step());
      if (!row) break;
      versions.emplace_back(query.Int64(0), query.Int64(1));
    }
  }
  for (const auto& [area_id, version_id] : versions) {
    SHIFTMAP_RETURN_IF_ERROR(VerifyVersion(database, area_id, version_id, defects));
  }
  return OkStatus();
}

}  // namespace shiftmap
