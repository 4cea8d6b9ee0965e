// SPDX-License-Identifier: Apache-2.0
#include "localizer/monitor/scan_consistency.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <span>

#include "mapstore/core/atomic_file.h"
#include "mapstore/core/csv.h"
#include "mapstore/core/input_file.h"
#include "mapstore/core/parse_whole.h"

namespace shiftmap {
namespace {

enum Column {
  kStamp,
  kX,
  kY,
  kYaw,
  kCovXx,
  kCovXy,
  kCovXyaw,
  kCovYy,
  kCovYyaw,
  kCovYawyaw,
  kNis,
  kDof,
  kColumns
};
constexpr std::array<const char*, kColumns> kNames = {"stamp_s",
                                                      "x_m",
                                                      "y_m",
                                                      "yaw_rad",
                                                      "cov_xx",
                                                      "cov_xy",
                                                      "cov_xyaw",
                                                      "cov_yy",
                                                      "cov_yyaw",
                                                      "cov_yawyaw",
                                                      "nis",
                                                      "dof"};

// Beyond this, seconds do not fit into a Stamp.
constexpr double kMaxStampS = 9.2e9;
constexpr double kMaxDof = 1e6;

using Row = std::array<double, kColumns>;

bool ParseNumber(const std::string& text, double* value) {
  *value = ParseWhole<double>(text).value_or(NAN);
  return std::isfinite(*value);
}

ScanConsistency FromRow(const Row& row) {
  ScanConsistency scan;
  scan.stamp = StampFromSeconds(row[kStamp]);
  scan.pose.T_map_vehicle = Se2(row[kX], row[kY], row[kYaw]);
  scan.pose.cov_T_map_vehicle << row[kCovXx], row[kCovXy], row[kCovXyaw], row[kCovXy], row[kCovYy],
      row[kCovYyaw], row[kCovXyaw], row[kCovYyaw], row[kCovYawyaw];
  scan.nis = row[kNis];
  scan.dof = std::llround(row[kDof]);
  return scan;
}

// The place of each column in a record; kInvalidArgument if one is missing.
StatusOr<std::array<std::size_t, kColumns>> FindColumns(const std::vector<std::string>& header,
                                                        const std::string& path) {
  std::array<std::size_t, kColumns> columns = {};
  for (std::size_t i = 0; i < kColumns; ++i) {
    const auto at = std::find(header.begin(), header.end(), kNames[i]);
    if (at == header.end()) {
      return InvalidArgument(
          "innovations '{}:1': no column {}, expected the file of --nis", path, kNames[i]);
    }
    columns[i] = static_cast<std::size_t>(at - header.begin());
  }
  return columns;
}

}  // namespace

std::vector<StampedPose> TrajectoryOf(const std::vector<ScanConsistency>& scans) {
  std::vector<StampedPose> trajectory;
  trajectory.reserve(scans.size());
  for (const ScanConsistency& scan : scans) {
    trajectory.push_back({scan.stamp, scan.pose.T_map_vehicle});
  }
  return trajectory;
}

Status WriteScanConsistency(const std::vector<ScanConsistency>& scans, const std::string& path) {
  std::string text = fmt::format("{}\n", fmt::join(kNames, ","));
  for (const ScanConsistency& scan : scans) {
    const Se2& T_map_vehicle = scan.pose.T_map_vehicle;
    const Eigen::Matrix3d& cov = scan.pose.cov_T_map_vehicle;
    fmt::format_to(std::back_inserter(text),
                   "{:.6f},{},{},{},{},{},{},{},{},{},{},{}\n",
                   ToSecondsSinceEpoch(scan.stamp),
                   T_map_vehicle.x(),
                   T_map_vehicle.y(),
                   T_map_vehicle.yaw(),
                   cov(0, 0),
                   cov(0, 1),
                   cov(0, 2),
                   cov(1, 1),
                   cov(1, 2),
                   cov(2, 2),
                   scan.nis,
                   scan.dof);
  }
  return WriteFileAtomically(path, text);
}

StatusOr<std::vector<ScanConsistency>> ReadScanConsistency(const std::string& path) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::string text, ReadInputFile("innovations", path));
  const StatusOr<std::vector<CsvRecord>> records = ParseCsv(text);
  if (!records.ok())
    return InvalidArgument("innovations '{}': {}", path, Message(records.status()));
  if (records->size() < 2) return InvalidArgument("innovations '{}': no scan", path);
  SHIFTMAP_ASSIGN_OR_RETURN(const auto columns, FindColumns(records->front().cells, path));
  std::vector<ScanConsistency> scans;
  for (const auto& [line, cells] : std::span(*records).subspan(1)) {
    Row row = {};
    bool good = cells.size() == records->front().cells.size();
    for (std::size_t i = 0; good && i < kColumns; ++i) {
      good = ParseNumber(cells[columns[i]], &row[i]);
    }
    good = good && std::abs(row[kStamp]) < kMaxStampS && row[kNis] >= 0.0 && row[kDof] >= 0.0 &&
           row[kDof] <= kMaxDof;
    if (!good) {
      return InvalidArgument("innovations '{}:{}': expected {} numbers in range",
                             path,
                             line,
                             records->front().cells.size());
    }
    scans.push_back(FromRow(row));
    if (scans.size() > 1 && scans.back().stamp < scans[scans.size() - 2].stamp) {
      return InvalidArgument("innovations '{}:{}': its stamp is before the last one", path, line);
    }
  }
  return scans;
}

}  // namespace shiftmap
