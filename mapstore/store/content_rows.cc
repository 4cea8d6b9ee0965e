// SPDX-License-Identifier: Apache-2.0
#include "mapstore/store/content_rows.h"

#include <cmath>
#include <map>
#include <utility>
#include <vector>

#include "mapstore/store/rhythm_rows.h"
#include "mapstore/store/vehicle_rows.h"

namespace shiftmap {
namespace {

// Into a statement for a version, an index within it, and the columns of ReadMode.
Status InsertMode(std::int64_t version_id, std::int64_t index, const Mode& mode, Statement* row) {
  row->Bind(version_id,
            index,
            mode.number.value(),
            mode.p_map_landmark.x(),
            mode.p_map_landmark.y(),
            mode.cov_p_map_landmark(0, 0),
            mode.cov_p_map_landmark(0, 1),
            mode.cov_p_map_landmark(1, 1),
            ToNanoseconds(mode.last_seen));
  return row->Execute();
}

Status InsertGroups(Database& database, std::int64_t version_id, const MapContent& content) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement group_row,
      database.Prepare("INSERT INTO landmark_group (version_id, group_index, signature, "
                       "leave_rate_per_s) VALUES (?1, ?2, ?3, ?4)"));
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement mode_row,
      database.Prepare("INSERT INTO mode (version_id, group_index, number, x_m, y_m, cov_xx_m2, "
                       "cov_xy_m2, cov_yy_m2, last_seen_ns) "
                       "VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9)"));
  std::int64_t group_index = 0;
  for (const LandmarkGroup& group : content.groups) {
    group_row.Bind(version_id, group_index, group.signature.text(), group.chain.leave_rate_per_s());
    SHIFTMAP_RETURN_IF_ERROR(group_row.Execute());
    for (const Mode& mode : group.modes) {
      SHIFTMAP_RETURN_IF_ERROR(InsertMode(version_id, group_index, mode, &mode_row));
    }
    ++group_index;
  }
  return OkStatus();
}

Status InsertMerged(Database& database, std::int64_t version_id, const MapContent& content) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement row,
      database.Prepare("INSERT INTO merged_mode (version_id, group_index, number, into_number) "
                       "VALUES (?1, ?2, ?3, ?4)"));
  for (std::size_t i = 0; i < content.groups.size(); ++i) {
    for (const MergedMode& merged : content.groups[i].merged) {
      row.Bind(
          version_id, static_cast<std::int64_t>(i), merged.number.value(), merged.into.value());
      SHIFTMAP_RETURN_IF_ERROR(row.Execute());
    }
  }
  return OkStatus();
}

Status InsertRates(Database& database, std::int64_t version_id, const MapContent& content) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement row,
      database.Prepare("INSERT INTO mode_rate (version_id, group_index, from_state, to_state, "
                       "rate_per_s) VALUES (?1, ?2, ?3, ?4, ?5)"));
  for (std::size_t i = 0; i < content.groups.size(); ++i) {
    const ModeChain& chain = content.groups[i].chain;
    if (chain.uniform()) continue;
    for (int from = 0; from < chain.states(); ++from) {
      for (int to = 0; to < chain.states(); ++to) {
        const double rate = chain.rate_matrix()(from, to);
        if (from == to || rate == 0.0) continue;
        row.Bind(version_id, static_cast<std::int64_t>(i), from, to, rate);
        SHIFTMAP_RETURN_IF_ERROR(row.Execute());
      }
    }
  }
  return OkStatus();
}

Status InsertCrossBlocks(Database& database,
                         std::int64_t version_id,
                         const JointCovariance& covariance) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement row,
      database.Prepare("INSERT INTO mode_covariance (version_id, row_index, column_index, "
                       "cov_xx_m2, cov_xy_m2, cov_yx_m2, cov_yy_m2) "
                       "VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7)"));
  for (const JointCovariance::CrossBlock& block : covariance.cross_blocks()) {
    row.Bind(version_id,
             block.row,
             block.column,
             block.value(0, 0),
             block.value(0, 1),
             block.value(1, 0),
             block.value(1, 1));
    SHIFTMAP_RETURN_IF_ERROR(row.Execute());
  }
  return OkStatus();
}

Status InsertAnonymous(Database& database,
                       std::int64_t version_id,
                       const std::vector<Mode>& landmarks) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement row,
      database.Prepare("INSERT INTO anonymous_landmark (version_id, landmark_index, number, x_m, "
                       "y_m, cov_xx_m2, cov_xy_m2, cov_yy_m2, last_seen_ns) "
                       "VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9)"));
  std::int64_t index = 0;
  for (const Mode& landmark : landmarks) {
    SHIFTMAP_RETURN_IF_ERROR(InsertMode(version_id, index++, landmark, &row));
  }
  return OkStatus();
}

// Columns from `first` on: number, x, y, cov xx, xy, yy, last seen.
Mode ReadMode(const Statement& row, int first) {
  Mode mode;
  mode.number = ModeNumber(row.Int64(first));
  mode.p_map_landmark = {row.Double(first + 1), row.Double(first + 2)};
  const double cov_xy = row.Double(first + 4);
  mode.cov_p_map_landmark << row.Double(first + 3), cov_xy, cov_xy, row.Double(first + 5);
  mode.last_seen = StampFromNanoseconds(row.Int64(first + 6));
  return mode;
}

Status ReadGroups(Database& database,
                  std::int64_t version_id,
                  std::vector<LandmarkGroup>& groups,
                  std::vector<double>& leave_rates) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement rows,
      database.Prepare("SELECT signature, leave_rate_per_s FROM landmark_group "
                       "WHERE version_id = ?1 ORDER BY group_index"));
  rows.Bind(version_id);
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, rows.Step());
    if (!row) return OkStatus();
    LandmarkGroup group;
    group.signature = Signature(rows.Text(0));
    leave_rates.push_back(rows.Double(1));
    groups.push_back(std::move(group));
  }
}

// Adds the modes to their groups.
Status ReadModes(Database& database,
                 std::int64_t version_id,
                 const std::string& owner,
                 std::vector<LandmarkGroup>& groups) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement rows,
      database.Prepare("SELECT group_index, number, x_m, y_m, cov_xx_m2, cov_xy_m2, cov_yy_m2, "
                       "last_seen_ns FROM mode WHERE version_id = ?1 "
                       "ORDER BY group_index, number"));
  rows.Bind(version_id);
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, rows.Step());
    if (!row) return OkStatus();
    const std::int64_t group_index = rows.Int64(0);
    if (group_index < 0 || group_index >= static_cast<std::int64_t>(groups.size())) {
      return DataLoss("{}: a mode of group {}, there are {}", owner, group_index, groups.size());
    }
    groups[static_cast<std::size_t>(group_index)].modes.push_back(ReadMode(rows, 1));
  }
}

Status ReadMerged(Database& database,
                  std::int64_t version_id,
                  const std::string& owner,
                  std::vector<LandmarkGroup>& groups) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement rows,
      database.Prepare("SELECT group_index, number, into_number FROM merged_mode "
                       "WHERE version_id = ?1 ORDER BY group_index, number"));
  rows.Bind(version_id);
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, rows.Step());
    if (!row) return OkStatus();
    const std::int64_t group_index = rows.Int64(0);
    if (group_index < 0 || group_index >= static_cast<std::int64_t>(groups.size())) {
      return DataLoss(
          "{}: a merged mode of group {}, there are {}", owner, group_index, groups.size());
    }
    groups[static_cast<std::size_t>(group_index)].merged.push_back(
        {ModeNumber(rows.Int64(1)), ModeNumber(rows.Int64(2))});
  }
}

// Replaces the uniform chains of the groups that have rates of their own.
Status ReadRates(Database& database,
                 std::int64_t version_id,
                 const std::string& owner,
                 std::vector<LandmarkGroup>& groups) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement rows,
      database.Prepare("SELECT group_index, from_state, to_state, rate_per_s FROM mode_rate "
                       "WHERE version_id = ?1 ORDER BY group_index, from_state, to_state"));
  rows.Bind(version_id);
  std::map<std::size_t, Eigen::MatrixXd> matrices;
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, rows.Step());
    if (!row) break;
    const std::int64_t group_index = rows.Int64(0);
    const std::int64_t from = rows.Int64(1);
    const std::int64_t to = rows.Int64(2);
    const bool known = group_index >= 0 && group_index < static_cast<std::int64_t>(groups.size());
    const int states = known ? groups[static_cast<std::size_t>(group_index)].chain.states() : 0;
    if (from < 0 || from >= states || to < 0 || to >= states || from == to) {
      return DataLoss("{}: a rate of group {} from {} to {}", owner, group_index, from, to);
    }
    const auto [matrix, added] = matrices.try_emplace(static_cast<std::size_t>(group_index),
                                                      Eigen::MatrixXd::Zero(states, states));
    matrix->second(from, to) = rows.Double(3);
  }
  for (auto& [group_index, matrix] : matrices) {
    matrix.diagonal() = -matrix.rowwise().sum();
    StatusOr<ModeChain> chain = ModeChain::FromRates(matrix);
    LandmarkGroup& group = groups[group_index];
    if (!chain.ok()) {
      return DataLoss("{}: group '{}': {}", owner, group.signature.text(), Message(chain.status()));
    }
    group.chain = *std::move(chain);
  }
  return OkStatus();
}

StatusOr<JointCovariance> ReadCovariance(Database& database,
                                         std::int64_t version_id,
                                         const std::string& owner,
                                         std::vector<Eigen::Matrix2d> diagonal) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement rows,
      database.Prepare("SELECT row_index, column_index, cov_xx_m2, cov_xy_m2, cov_yx_m2, cov_yy_m2 "
                       "FROM mode_covariance WHERE version_id = ?1 "
                       "ORDER BY row_index, column_index"));
  rows.Bind(version_id);
  const auto size = static_cast<std::int64_t>(diagonal.size());
  std::vector<JointCovariance::CrossBlock> blocks;
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool more, rows.Step());
    if (!more) return JointCovariance(std::move(diagonal), std::move(blocks));
    const std::int64_t row = rows.Int64(0);
    const std::int64_t column = rows.Int64(1);
    if (row < 0 || row >= column || column >= size) {
      return DataLoss("{}: covariance block ({}, {}) of {} modes", owner, row, column, size);
    }
    JointCovariance::CrossBlock block{static_cast<int>(row), static_cast<int>(column), {}};
    block.value << rows.Double(2), rows.Double(3), rows.Double(4), rows.Double(5);
    blocks.push_back(block);
  }
}

Status ReadAnonymous(Database& database, std::int64_t version_id, std::vector<Mode>& landmarks) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement rows,
      database.Prepare("SELECT number, x_m, y_m, cov_xx_m2, cov_xy_m2, cov_yy_m2, last_seen_ns "
                       "FROM anonymous_landmark WHERE version_id = ?1 ORDER BY landmark_index"));
  rows.Bind(version_id);
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, rows.Step());
    if (!row) return OkStatus();
    landmarks.push_back(ReadMode(rows, 0));
  }
}

}  // namespace

Status InsertContentRows(Database& database, std::int64_t version_id, const MapContent& content) {
  SHIFTMAP_RETURN_IF_ERROR(InsertGroups(database, version_id, content));
  SHIFTMAP_RETURN_IF_ERROR(InsertMerged(database, version_id, content));
  SHIFTMAP_RETURN_IF_ERROR(InsertRates(database, version_id, content));
  SHIFTMAP_RETURN_IF_ERROR(InsertRhythmRows(database, version_id, content.groups));
  SHIFTMAP_RETURN_IF_ERROR(InsertCrossBlocks(database, version_id, content.covariance));
  SHIFTMAP_RETURN_IF_ERROR(InsertAnonymous(database, version_id, content.anonymous_landmarks));
  return InsertVehicleRows(database, version_id, content.vehicles);
}

Status ReadContentRows(Database& database,
                       std::int64_t version_id,
                       const std::string& owner,
                       MapContent& content) {
  std::vector<double> leave_rates;
  SHIFTMAP_RETURN_IF_ERROR(ReadGroups(database, version_id, content.groups, leave_rates));
  SHIFTMAP_RETURN_IF_ERROR(ReadModes(database, version_id, owner, content.groups));
  std::vector<Eigen::Matrix2d> diagonal;
  for (std::size_t i = 0; i < content.groups.size(); ++i) {
    LandmarkGroup& group = content.groups[i];
    if (!(leave_rates[i] >= 0.0) || !std::isfinite(leave_rates[i])) {
      return DataLoss(
          "{}: group '{}': leave rate {}", owner, group.signature.text(), leave_rates[i]);
    }
    group.chain = ModeChain::Uniform(static_cast<int>(group.modes.size()), leave_rates[i]);
    for (const Mode& mode : group.modes) diagonal.push_back(mode.cov_p_map_landmark);
  }
  SHIFTMAP_RETURN_IF_ERROR(ReadMerged(database, version_id, owner, content.groups));
  SHIFTMAP_RETURN_IF_ERROR(ReadRates(database, version_id, owner, content.groups));
  SHIFTMAP_RETURN_IF_ERROR(ReadRhythmRows(database, version_id, owner, content.groups));
  SHIFTMAP_ASSIGN_OR_RETURN(content.covariance,
                            ReadCovariance(database, version_id, owner, std::move(diagonal)));
  SHIFTMAP_RETURN_IF_ERROR(ReadAnonymous(database, version_id, content.anonymous_landmarks));
  return ReadVehicleRows(database, version_id, content.vehicles);
}

}  // namespace shiftmap
