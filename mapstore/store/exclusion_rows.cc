// SPDX-License-Identifier: Apache-2.0
#include "mapstore/store/exclusion_rows.h"

#include <algorithm>
#include <utility>

#include "mapstore/map/shift_report_check.h"
#include "mapstore/sqlite/row_checksum.h"

namespace shiftmap {
namespace {

// Of the exclusion that holds.
constexpr char kEnd[] =
    "UPDATE exclusion SET included_ns = ?4, checksum = row_checksum(area_id, run, vehicle, "
    "since_ns, held, reason, excluded_ns, ?4) "
    "WHERE area_id = ?1 AND run = ?2 AND vehicle = ?3 AND included_ns IS NULL ";

}  // namespace

StatusOr<std::vector<Exclusion>> ReadExclusions(Database& database,
                                                std::int64_t area_id,
                                                std::optional<Stamp> known) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare(
          "SELECT run, vehicle, since_ns, reason, held, excluded_ns FROM exclusion "
          "WHERE area_id = ?1 AND iif(?2 IS NULL, included_ns IS NULL, "
          "excluded_ns <= ?2 AND coalesce(included_ns > ?2, 1)) ORDER BY held, vehicle, run"));
  std::optional<std::int64_t> known_ns;
  if (known) known_ns = ToNanoseconds(*known);
  query.Bind(area_id, known_ns);
  std::vector<Exclusion> exclusions;
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, query.Step());
    if (!row) return exclusions;
    exclusions.push_back({query.Text(0),
                          query.Text(1),
                          StampFromNanoseconds(query.Int64(2)),
                          query.Text(3),
                          query.Int64(4) != 0,
                          StampFromNanoseconds(query.Int64(5))});
  }
}

const Exclusion* AddExclusion(Exclusion exclusion, std::vector<Exclusion>* holding) {
  if (!exclusion.run.empty()) exclusion.since = {};
  const auto same = std::find_if(holding->begin(), holding->end(), [&](const Exclusion& other) {
    return other.run == exclusion.run && other.vehicle == exclusion.vehicle;
  });
  if (same == holding->end()) return &holding->emplace_back(std::move(exclusion));
  const bool stronger = same->held && !exclusion.held;
  const bool longer = same->held == exclusion.held && exclusion.since < same->since;
  if (!stronger && !longer) return nullptr;
  exclusion.since = std::min(exclusion.since, same->since);
  *same = std::move(exclusion);
  return &*same;
}

Status WriteExclusion(Database& database, std::int64_t area_id, const Exclusion& exclusion) {
  SHIFTMAP_RETURN_IF_ERROR(EndExclusion(database, area_id, exclusion, exclusion.excluded).status());
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement row,
      database.Prepare(InsertRowSql(
          "exclusion", "area_id, run, vehicle, since_ns, held, reason, excluded_ns, included_ns")));
  row.Bind(area_id,
           exclusion.run,
           exclusion.vehicle,
           ToNanoseconds(exclusion.since),
           exclusion.held ? 1 : 0,
           exclusion.reason,
           ToNanoseconds(exclusion.excluded),
           std::optional<std::int64_t>());
  return row.Execute();
}

StatusOr<bool> InsertExclusion(Database& database, std::int64_t area_id, Exclusion exclusion) {
  SHIFTMAP_ASSIGN_OR_RETURN(std::vector<Exclusion> holding, ReadExclusions(database, area_id));
  const Exclusion* const added = AddExclusion(std::move(exclusion), &holding);
  if (added == nullptr) return false;
  SHIFTMAP_RETURN_IF_ERROR(WriteExclusion(database, area_id, *added));
  return true;
}

StatusOr<bool> EndExclusion(Database& database,
                            std::int64_t area_id,
                            const Exclusion& exclusion,
                            Stamp ended) {
  SHIFTMAP_ASSIGN_OR_RETURN(Statement row, database.Prepare(kEnd));
  row.Bind(area_id, exclusion.run, exclusion.vehicle, ToNanoseconds(ended));
  SHIFTMAP_RETURN_IF_ERROR(row.Execute());
  return database.Changes() > 0;
}

StatusOr<std::optional<Exclusion>> ExcludeRunOfReport(Database& database,
                                                      std::int64_t area_id,
                                                      const std::string& uuid,
                                                      const std::string& run,
                                                      Stamp received) {
  if (uuid == run) return std::optional<Exclusion>();
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<Exclusion> exclusions,
                            ReadExclusions(database, area_id));
  const auto found = std::find_if(exclusions.begin(), exclusions.end(), [&](const auto& exclusion) {
    return exclusion.vehicle.empty() && exclusion.run == uuid;
  });
  if (found == exclusions.end()) return std::optional<Exclusion>();
  Exclusion exclusion = *found;
  SHIFTMAP_RETURN_IF_ERROR(EndExclusion(database, area_id, exclusion, received).status());
  exclusion.run = run;
  exclusion.excluded = received;
  SHIFTMAP_ASSIGN_OR_RETURN(const bool added, InsertExclusion(database, area_id, exclusion));
  return added ? std::optional(exclusion) : std::nullopt;
}

StatusOr<bool> WasIncluded(Database& database, std::int64_t area_id, const std::string& run) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare("SELECT 1 FROM exclusion WHERE area_id = ?1 AND run = ?2 "
                       "AND included_ns IS NOT NULL LIMIT 1"));
  query.Bind(area_id, run);
  return query.Step();
}

StatusOr<std::string> FindRun(Database& database, std::int64_t area_id, const std::string& given) {
  const std::string text = IsUuid(given) ? LowerCaseUuid(given) : given;
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare(
          "SELECT identity FROM run JOIN version_run USING (run_id) "
          "JOIN version USING (version_id) WHERE area_id = ?2 "
          "AND (substr(identity, 1, length(?1)) = ?1 "
          "OR substr(sha256, 1, length(?1)) = ?1 OR name = ?1) UNION "
          "SELECT identity FROM shift_report JOIN version USING (version_id) WHERE area_id = ?2 "
          "AND (substr(identity, 1, length(?1)) = ?1 "
          "OR substr(uuid, 1, length(?1)) = ?1 OR substr(run_hash, 1, length(?1)) = ?1)"));
  query.Bind(text, area_id);
  SHIFTMAP_ASSIGN_OR_RETURN(const bool found, query.Step());
  if (!found) {
    // A run that has not come yet.
    if (IsSha256Hex(text) || IsUuid(text)) return text;
    return NotFound(
        "{}: no run '{}': expected the UUID of a run or a report, a log's SHA-256, how it begins, "
        "or the name of a log that a build has mapped",
        database.name(),
        text);
  }
  std::string run = query.Text(0);
  SHIFTMAP_ASSIGN_OR_RETURN(const bool another, query.Step());
  if (!another) return run;
  return InvalidArgument("{}: more than one run is or begins with '{}'", database.name(), text);
}

StatusOr<std::optional<std::string>> ExcludedVehicleOf(Database& database,
                                                       std::int64_t area_id,
                                                       const std::string& identity,
                                                       const std::vector<Exclusion>& holding) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare("SELECT vehicle, begin_ns FROM run JOIN version_run USING (run_id) "
                       "JOIN version USING (version_id) WHERE identity = ?1 AND area_id = ?2 UNION "
                       "SELECT r.vehicle, r.begin_ns FROM shift_report r "
                       "JOIN version USING (version_id) WHERE identity = ?1 AND area_id = ?2"));
  query.Bind(identity, area_id);
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, query.Step());
    if (!row) return std::optional<std::string>();
    const Exclusion* const found =
        FindExclusion(holding, identity, "", query.Text(0), StampFromNanoseconds(query.Int64(1)));
    if (found != nullptr && !found->vehicle.empty()) return found->vehicle;
  }
}

StatusOr<std::set<std::string>> NamesOfRun(Database& database,
                                           std::int64_t area_id,
                                           const std::string& identity) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare("SELECT sha256 FROM run WHERE identity = ?1 UNION "
                       "SELECT r.run_hash FROM shift_report r JOIN version USING (version_id) "
                       "WHERE identity = ?1 AND area_id = ?2 AND run_hash <> '' UNION "
                       "SELECT r.uuid FROM shift_report r JOIN version USING (version_id) "
                       "WHERE identity = ?1 AND area_id = ?2"));
  query.Bind(identity, area_id);
  std::set<std::string> names{identity};
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, query.Step());
    if (!row) return names;
    names.insert(query.Text(0));
  }
}

const Exclusion* FindExclusion(const std::vector<Exclusion>& exclusions,
                               const std::string& run,
                               const std::string& sha256,
                               const std::string& vehicle,
                               Stamp begin) {
  const auto found =
      std::find_if(exclusions.begin(), exclusions.end(), [&](const Exclusion& exclusion) {
        return exclusion.vehicle.empty()
                   ? exclusion.run == run || (!sha256.empty() && exclusion.run == sha256)
                   : exclusion.vehicle == vehicle && begin >= exclusion.since;
      });
  return found == exclusions.end() ? nullptr : &*found;
}

const Exclusion* FindExclusion(const std::vector<Exclusion>& exclusions, const RunRecord& run) {
  return FindExclusion(exclusions, run.identity(), run.sha256, run.vehicle, run.begin);
}

}  // namespace shiftmap
