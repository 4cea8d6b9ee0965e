// SPDX-License-Identifier: Apache-2.0
#include "mapstore/store/visibility_rows.h"

#include <algorithm>
#include <map>
#include <utility>

#include "mapstore/sqlite/row_checksum.h"
#include "mapstore/store/blob.h"
#include "mapstore/store/ledger_view.h"

namespace shiftmap {
namespace {

// Scans of one run in one direction; beyond it a detector's share is known to no end.
constexpr int kMostScans = 1'000'000;

std::string PackScans(const Visibility& scans) {
  BlobWriter blob;
  for (std::size_t i = 0; i < scans.seen.size(); ++i) {
    blob.Add(std::int64_t{std::min(scans.seen[i], kMostScans)});
    blob.Add(std::int64_t{std::min(scans.missed[i], kMostScans)});
  }
  return blob.bytes();
}

}  // namespace

std::optional<Visibility> UnpackScans(std::string_view bytes) {
  Visibility scans;
  if (bytes.size() != 2 * scans.seen.size() * sizeof(std::int64_t)) return std::nullopt;
  BlobReader blob(bytes);
  for (std::size_t i = 0; i < scans.seen.size(); ++i) {
    for (int* const count : {&scans.seen[i], &scans.missed[i]}) {
      const std::int64_t stored = blob.Integer();
      if (stored < 0 || stored > kMostScans) return std::nullopt;
      *count = static_cast<int>(stored);
    }
  }
  return scans;
}

Status InsertVisibility(Database& database,
                        std::int64_t version_id,
                        std::int64_t run_id,
                        const std::vector<ModeVisibility>& visibility) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement row,
      database.Prepare(
          InsertRowSql("mapped_visibility", "version_id, run_id, signature, mode, scans")));
  for (const ModeVisibility& mode : visibility) {
    const std::string scans = PackScans(mode.scans);
    row.Bind(version_id, run_id, mode.signature.text(), mode.mode.value(), BlobView{scans});
    SHIFTMAP_RETURN_IF_ERROR(row.Execute());
  }
  return OkStatus();
}

StatusOr<std::vector<ModeVisibility>> ReadLineVisibility(
    Database& database,
    std::int64_t area_id,
    const VersionRow& version,
    const std::set<std::string>& without_runs) {
  LedgerView view(database, version);
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare("SELECT m.version_id, m.run_id, m.signature, m.mode, m.scans, r.sha256, "
                       "r.identity FROM mapped_visibility m JOIN version v USING (version_id) "
                       "JOIN run r USING (run_id) WHERE v.area_id = ?1"));
  query.Bind(area_id);
  std::map<std::pair<std::string, std::int64_t>, Visibility> sums;
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool found, query.Step());
    if (!found) break;
    if (without_runs.contains(query.Text(5)) || without_runs.contains(query.Text(6))) continue;
    SHIFTMAP_ASSIGN_OR_RETURN(const bool tells,
                              view.TellsOfPast(0, query.Int64(1), query.Int64(0)));
    if (!tells) continue;
    const std::optional<Visibility> scans = UnpackScans(query.Blob(4));
    if (!scans) {
      return DataLoss("{}: visibility of '{}' in version row {} is damaged",
                      database.name(),
                      query.Text(2),
                      query.Int64(0));
    }
    SHIFTMAP_ASSIGN_OR_RETURN(const std::string_view name,
                              view.NameOf(query.Blob(2), query.Int64(0)));
    sums[{std::string(name), query.Int64(3)}] += *scans;
  }
  std::vector<ModeVisibility> visibility;
  for (const auto& [mode, scans] : sums) {
    visibility.push_back({Signature(mode.first), ModeNumber(mode.second), scans});
  }
  return visibility;
}

}  // namespace shiftmap
