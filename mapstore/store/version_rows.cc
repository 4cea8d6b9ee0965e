// SPDX-License-Identifier: Apache-2.0
#include "mapstore/store/version_rows.h"

#include <fmt/ranges.h>

#include <string_view>
#include <tuple>
#include <unordered_map>
#include <utility>

#include "mapstore/core/nearest_name.h"
#include "mapstore/map/mode_filter.h"
#include "mapstore/sqlite/row_checksum.h"
#include "mapstore/store/content_rows.h"

namespace shiftmap {
namespace {

VersionRow ReadVersionRow(const Statement& row) {
  VersionRow version;
  version.version_id = row.Int64(0);
  version.number = VersionNumber(row.Int64(1));
  if (!row.IsNull(2)) version.parent_version_id = row.Int64(2);
  version.content_hash = row.Text(3);
  version.content_stored = row.Int64(4) != 0;
  version.stamp = StampFromNanoseconds(row.Int64(5));
  version.ledger_position = LedgerPosition(row.Int64(6));
  if (!row.IsNull(7)) version.statement_version_id = row.Int64(7);
  version.created = StampFromNanoseconds(row.Int64(8));
  return version;
}

Status ReadCalibration(Database& database, std::int64_t version_id, Calibration& calibration) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement row,
      database.Prepare(
          "SELECT odometry_scale_v, odometry_scale_omega, odometry_lag_s, odometry_sd_log_scale, "
          "odometry_noise_v_m_per_sqrt_s, odometry_noise_omega_rad_per_sqrt_s, sensor_sd_range_m, "
          "sensor_sd_bearing_rad, sensor_sd_position_m, "
          "sensor_range_curvature_per_rad2, sensor_mean_squared_bearing_rad2, sensor_max_range_m, "
          "sensor_max_bearing_rad, sensor_detection_probability, "
          "sensor_occluded_visit_probability, sensor_clutter_density_per_m2, "
          "sensor_new_landmark_density_per_m2 FROM version WHERE version_id = ?1"));
  row.Bind(version_id);
  SHIFTMAP_RETURN_IF_ERROR(row.Step().status());
  int column = 0;
  for (double* value : CalibrationValues(&calibration)) *value = row.Double(column++);
  return OkStatus();
}

// The probabilities that a version states, or else its chains' stationary distributions.
Status SetOwnProbabilities(Database& database,
                           const VersionRow& version,
                           const std::string& owner,
                           MapContent* content) {
  if (!version.states_probabilities()) {
    for (LandmarkGroup& group : content->groups) {
      group.probabilities = group.chain.stationary();
    }
    return OkStatus();
  }
  std::vector<std::string> names;
  for (const LandmarkGroup& group : content->groups) names.push_back(group.signature.text());
  SHIFTMAP_ASSIGN_OR_RETURN(const auto stated,
                            ReadStatement(database, version.version_id, content->groups, names));
  for (std::size_t i = 0; i < stated.size(); ++i) {
    LandmarkGroup& group = content->groups[i];
    if (!stated[i]) return DataLoss("{}: group '{}': no statement", owner, group.signature.text());
    group.probabilities = *stated[i];
  }
  return OkStatus();
}

Status InsertStatement(Database& database,
                       std::int64_t version_id,
                       const std::vector<LandmarkGroup>& groups) {
  SHIFTMAP_ASSIGN_OR_RETURN(Statement row,
                            database.Prepare(InsertRowSql(
                                "stated_probability", "version_id, signature, mode, probability")));
  for (const LandmarkGroup& group : groups) {
    for (int state = 0; state < group.chain.states(); ++state) {
      row.Bind(version_id,
               group.signature.text(),
               group.NumberOf(state).value(),
               group.probabilities(state));
      SHIFTMAP_RETURN_IF_ERROR(row.Execute());
    }
  }
  SHIFTMAP_ASSIGN_OR_RETURN(Statement version,
                            database.Prepare("UPDATE version SET statement_version_id = version_id "
                                             "WHERE version_id = ?1"));
  version.Bind(version_id);
  SHIFTMAP_RETURN_IF_ERROR(version.Execute());
  return SetChecksums(database, "version", fmt::format("version_id = {}", version_id));
}

// What the store has instead of an area that it does not have, for a message.
StatusOr<std::string> AreaNames(Database& database, const std::string& area) {
  constexpr std::size_t kMost = 8;
  SHIFTMAP_ASSIGN_OR_RETURN(Statement query, database.Prepare("SELECT name FROM area ORDER BY 1"));
  std::vector<std::string> names;
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, query.Step());
    if (!row) break;
    names.push_back(query.Text(0));
  }
  if (names.empty()) return std::string("the store has no areas");
  if (names.size() > kMost) {
    return fmt::format("the store has {} areas{}", names.size(), DidYouMean(area, names));
  }
  return fmt::format("the store has: {}", fmt::join(names, ", "));
}

}  // namespace

StatusOr<std::optional<AreaRow>> FindArea(Database& database, const std::string& area) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare("SELECT a.area_id, v.number FROM area a LEFT JOIN version v "
                       "ON v.version_id = a.published_version_id WHERE a.name = ?1"));
  query.Bind(area);
  SHIFTMAP_ASSIGN_OR_RETURN(const bool found, query.Step());
  if (!found) return std::optional<AreaRow>();
  AreaRow row{query.Int64(0), std::nullopt};
  if (!query.IsNull(1)) row.published = VersionNumber(query.Int64(1));
  return std::optional<AreaRow>(row);
}

StatusOr<AreaRow> GetArea(Database& database, const std::string& area) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::optional<AreaRow> row, FindArea(database, area));
  if (row) return *row;
  SHIFTMAP_ASSIGN_OR_RETURN(const std::string names, AreaNames(database, area));
  return NotFound("{}: no area '{}'; {}", database.name(), area, names);
}

StatusOr<VersionRow> GetVersion(Database& database,
                                const std::string& area,
                                std::int64_t area_id,
                                VersionNumber number) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare(
          "SELECT version_id, number, parent_version_id, content_hash, content_stored, "
          "stamp_ns, ledger_position, statement_version_id, created_ns FROM version "
          "WHERE area_id = ?1 AND number = ?2"));
  query.Bind(area_id, number.value());
  SHIFTMAP_ASSIGN_OR_RETURN(const bool found, query.Step());
  if (!found) {
    return NotFound("{}: area '{}': no version {}", database.name(), area, number.value());
  }
  return ReadVersionRow(query);
}

StatusOr<VersionRow> GetVersionById(Database& database, std::int64_t version_id) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare(
          "SELECT version_id, number, parent_version_id, content_hash, content_stored, "
          "stamp_ns, ledger_position, statement_version_id, created_ns FROM version "
          "WHERE version_id = ?1"));
  query.Bind(version_id);
  SHIFTMAP_ASSIGN_OR_RETURN(const bool found, query.Step());
  if (!found) return DataLoss("{}: no version row {}", database.name(), version_id);
  return ReadVersionRow(query);
}

StatusOr<MapContent> ReadContent(Database& database,
                                 const VersionRow& version,
                                 const std::string& owner) {
  if (!version.content_stored) {
    return NotFound("{}: its content is not in this file any more, only its row", owner);
  }
  MapContent content;
  content.stamp = version.stamp;
  SHIFTMAP_RETURN_IF_ERROR(ReadCalibration(database, version.version_id, content.calibration));
  SHIFTMAP_RETURN_IF_ERROR(ReadContentRows(database, version.version_id, owner, content));
  SHIFTMAP_RETURN_IF_ERROR(SetOwnProbabilities(database, version, owner, &content));
  const std::string hash =
      version.states_probabilities() ? ContentHash(content) : GeometryHash(content);
  if (hash != version.content_hash) {
    return DataLoss("{}: content hash {}, expected {}", owner, hash, version.content_hash);
  }
  // A file that was forged may have a hash that fits.
  const Status valid = ValidateMapContent(content);
  if (!valid.ok()) return DataLoss("{}: {}", owner, Message(valid));
  return content;
}

StatusOr<std::vector<std::optional<Eigen::VectorXd>>> ReadStatement(
    Database& database,
    std::int64_t version_id,
    const std::vector<LandmarkGroup>& groups,
    const std::vector<std::string>& names,
    const std::vector<std::vector<ModeSplit>>& splits) {
  std::unordered_map<std::string_view, std::size_t> index;
  for (std::size_t i = 0; i < names.size(); ++i) index.emplace(names[i], i);
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement rows,
      database.Prepare("SELECT signature, mode, probability FROM stated_probability "
                       "WHERE version_id = ?1 ORDER BY signature, mode"));
  rows.Bind(version_id);
  std::vector<std::vector<StatedMode>> modes(groups.size());
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, rows.Step());
    if (!row) break;
    const auto found = index.find(rows.Blob(0));
    if (found == index.end()) continue;
    const StatedMode mode{ModeNumber(rows.Int64(1)), rows.Double(2)};
    if (!(mode.probability >= 0.0 && mode.probability <= 1.0)) {
      return DataLoss("{}: version row {}: stated probability {} of '{}'",
                      database.name(),
                      version_id,
                      mode.probability,
                      rows.Text(0));
    }
    modes[found->second].push_back(mode);
  }
  std::vector<std::optional<Eigen::VectorXd>> stated(groups.size());
  for (std::size_t i = 0; i < groups.size(); ++i) {
    if (modes[i].empty()) continue;
    if (!splits.empty()) {
      for (const ModeSplit& split : splits[i]) {
        modes[i] = SplitStatement(groups[i], split, std::move(modes[i]));
      }
    }
    stated[i] = CarriedProbabilities(groups[i], modes[i]);
  }
  return stated;
}

StatusOr<VersionRow> InsertVersion(Database& database,
                                   std::int64_t area_id,
                                   VersionRow version,
                                   bool states_probabilities,
                                   const MapContent& content,
                                   const Provenance& provenance) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement row,
      database.Prepare(InsertRowSql(
          "version",
          "area_id, number, parent_version_id, content_hash, content_stored, stamp_ns, created_ns, "
          "tool, configuration, seed, "
          "odometry_scale_v, odometry_scale_omega, odometry_lag_s, odometry_sd_log_scale, "
          "odometry_noise_v_m_per_sqrt_s, odometry_noise_omega_rad_per_sqrt_s, sensor_sd_range_m, "
          "sensor_sd_bearing_rad, sensor_sd_position_m, "
          "sensor_range_curvature_per_rad2, sensor_mean_squared_bearing_rad2, sensor_max_range_m, "
          "sensor_max_bearing_rad, sensor_detection_probability, "
          "sensor_occluded_visit_probability, sensor_clutter_density_per_m2, "
          "sensor_new_landmark_density_per_m2, ledger_position, statement_version_id, "
          "edited_version_id")));
  std::apply(
      [&](const auto&... calibration) {
        row.Bind(area_id,
                 version.number.value(),
                 version.parent_version_id,
                 version.content_hash,
                 1,
                 ToNanoseconds(content.stamp),
                 ToNanoseconds(version.created),
                 provenance.tool,
                 provenance.configuration,
                 provenance.seed,
                 calibration...,
                 version.ledger_position.value(),
                 version.statement_version_id,
                 std::optional<std::int64_t>());
      },
      CalibrationValues(content.calibration));
  SHIFTMAP_RETURN_IF_ERROR(row.Execute());
  version.version_id = database.LastInsertRowId();
  SHIFTMAP_RETURN_IF_ERROR(InsertContentRows(database, version.version_id, content));
  if (!states_probabilities) return version;
  version.statement_version_id = version.version_id;
  SHIFTMAP_RETURN_IF_ERROR(InsertStatement(database, version.version_id, content.groups));
  return version;
}

}  // namespace shiftmap
