// SPDX-License-Identifier: Apache-2.0
#include <Eigen/SparseCholesky>
#include <vector>

#include "mapstore/maintenance/verify_rows.h"
#include "mapstore/schema/store_file.h"
#include "mapstore/store/blob.h"
#include "mapstore/store/version_rows.h"

namespace shiftmap {
namespace {

std::string VersionKey(const std::string& area, VersionNumber number) {
  return fmt::format("area '{}', version {}", area, number.value());
}

// True if the joint covariance of all modes is positive definite.
bool IsPositiveDefinite(const JointCovariance& covariance) {
  std::vector<Eigen::Triplet<double>> entries;
  const auto add = [&](int row, int column, const Eigen::Matrix2d& block) {
    for (int i = 0; i < 2; ++i) {
      for (int j = 0; j < 2; ++j) entries.emplace_back(2 * row + i, 2 * column + j, block(i, j));
    }
  };
  for (int i = 0; i < covariance.size(); ++i) add(i, i, covariance.Block(i, i));
  for (const JointCovariance::CrossBlock& block : covariance.cross_blocks()) {
    // The lower half, which the factorization reads.
    add(block.column, block.row, block.value.transpose());
  }
  const Eigen::Index rows = Eigen::Index{2} * covariance.size();
  Eigen::SparseMatrix<double> matrix(rows, rows);
  matrix.setFromTriplets(entries.begin(), entries.end());
  const Eigen::SimplicialLLT<Eigen::SparseMatrix<double>, Eigen::Lower> factor(matrix);
  return factor.info() == Eigen::Success;
}

Status VerifyContent(Database& database,
                     const std::string& key,
                     const VersionRow& version,
                     DefectList* defects) {
  const StatusOr<MapContent> content = ReadContent(database, version, key);
  if (content.ok()) {
    if (!IsPositiveDefinite(content->covariance)) {
      defects->Add("mode_covariance", key, "joint covariance is not positive definite");
    }
    return OkStatus();
  }
  if (content.status().code() != StatusCode::kDataLoss) return content.status();
  defects->Add("version", key, Message(content.status()));
  return OkStatus();
}

Status VerifyTrajectories(Database& database,
                          const std::string& key,
                          std::int64_t version_id,
                          DefectList* defects) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement rows,
      database.Prepare("SELECT name, trajectory FROM version_run JOIN run USING (run_id) "
                       "WHERE version_id = ?1"));
  rows.Bind(version_id);
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, rows.Step());
    if (!row) return OkStatus();
    if (!UnpackTrajectory(rows.Blob(1))) {
      defects->Add("version_run", key + ", run '" + rows.Text(0) + "'", "trajectory is damaged");
    }
  }
}

Status VerifyPublished(Database& database, DefectList* defects) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement rows,
      database.Prepare("SELECT a.name, v.area_id = a.area_id, v.content_stored FROM area a "
                       "JOIN version v ON v.version_id = a.published_version_id"));
  rows.Bind();
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, rows.Step());
    if (!row) return OkStatus();
    const std::string key = fmt::format("area '{}'", rows.Text(0));
    if (rows.Int64(1) == 0) defects->Add("area", key, "publishes a version of another area");
    if (rows.Int64(2) == 0) defects->Add("area", key, "publishes a version without content");
  }
}

}  // namespace

Status VerifyVersions(Database& database, DefectList* defects) {
  SHIFTMAP_RETURN_IF_ERROR(VerifyPublished(database, defects));
  SHIFTMAP_ASSIGN_OR_RETURN(const bool snapshot, IsSnapshot(database));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::int64_t reports,
                            database.QueryInt64("SELECT coalesce(max(report_id), 0) "
                                                "FROM shift_report"));
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement rows,
      database.Prepare(
          "SELECT v.version_id, a.name, "
          "p.area_id = v.area_id AND p.number < v.number, "
          "v.content_stored = 0 OR v.statement_version_id IS v.version_id "
          "OR p.content_stored = 0 OR v.statement_version_id IS p.statement_version_id "
          "FROM version v JOIN area a USING (area_id) LEFT JOIN version p "
          "ON p.version_id = v.parent_version_id ORDER BY v.version_id"));
  rows.Bind();
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, rows.Step());
    if (!row) return OkStatus();
    ++defects->result().versions;
    SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow version, GetVersionById(database, rows.Int64(0)));
    const std::string key = VersionKey(rows.Text(1), version.number);
    if (version.parent_version_id && rows.Int64(2) == 0) {
      defects->Add("version", key, "its parent is not an older version of the area");
    }
    if (rows.Int64(3) == 0) {
      defects->Add("version", key, "the statement that holds is neither its own nor its parent's");
    }
    if (version.ledger_position.value() < 0 ||
        (!snapshot && version.content_stored && version.ledger_position.value() > reports)) {
      defects->Add("version", key, "accounts for reports that are not there");
    }
    if (version.content_stored) {
      SHIFTMAP_RETURN_IF_ERROR(VerifyContent(database, key, version, defects));
    }
    SHIFTMAP_RETURN_IF_ERROR(VerifyTrajectories(database, key, version.version_id, defects));
  }
}

}  // namespace shiftmap
