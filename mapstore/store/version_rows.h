// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "mapstore/map/mode_split.h"
#include "mapstore/map_store.h"
#include "mapstore/sqlite/database.h"
#include "proto/core/status.h"

namespace shiftmap {

/// A row of `area`.
struct AreaRow {
  std::int64_t area_id = 0;
  std::optional<VersionNumber> published;
};

/// A row of `version` without what only LoadVersion needs.
struct VersionRow {
  std::int64_t version_id = 0;
  VersionNumber number;
  std::optional<std::int64_t> parent_version_id;
  std::string content_hash;
  bool content_stored = true;
  Stamp stamp;
  Stamp created;                   ///< By the clock of the machine that committed it.
  LedgerPosition ledger_position;  ///< Of its statement, if it makes one.

  /// Whose statement holds for the version: its own, or the nearest ancestor's.
  std::optional<std::int64_t> statement_version_id;

  bool states_probabilities() const { return statement_version_id == version_id; }
};

/// The area by name, or nothing.
StatusOr<std::optional<AreaRow>> FindArea(Database& database, const std::string& area);

/// As FindArea. Errors: kNotFound.
StatusOr<AreaRow> GetArea(Database& database, const std::string& area);

/// Errors: kNotFound if the area has no such version.
StatusOr<VersionRow> GetVersion(Database& database,
                                const std::string& area,
                                std::int64_t area_id,
                                VersionNumber number);

/// Errors: kDataLoss if there is none: rows refer to it.
StatusOr<VersionRow> GetVersionById(Database& database, std::int64_t version_id);

/// The version's content, verified against its hash. Probabilities that it does not state are those
/// of the chains' stationary distributions. `owner` starts the messages.
/// Errors: kDataLoss if it does not verify; kNotFound if the file has only the version's row.
StatusOr<MapContent> ReadContent(Database& database,
                                 const VersionRow& version,
                                 const std::string& owner);

/// What a version says of its groups' probabilities, for groups that have other modes since: a mode
/// that it does not have gets the probability of `absent`. By `groups`; nothing for one that it
/// does not have.
/// @param names   The groups' names in the version that states, in the order of `groups`.
/// @param splits  In the order of `groups`: modes that were split since; empty if none were.
StatusOr<std::vector<std::optional<Eigen::VectorXd>>> ReadStatement(
    Database& database,
    std::int64_t version_id,
    const std::vector<LandmarkGroup>& groups,
    const std::vector<std::string>& names,
    const std::vector<std::vector<ModeSplit>>& splits = {});

/// Adds a version row and its content; with its statement if `states_probabilities`, else that of
/// its parent holds. Returns the row with its id.
/// @param version  Without its id.
StatusOr<VersionRow> InsertVersion(Database& database,
                                   std::int64_t area_id,
                                   VersionRow version,
                                   bool states_probabilities,
                                   const MapContent& content,
                                   const Provenance& provenance);

}  // namespace shiftmap
