// SPDX-License-Identifier: Apache-2.0
#include "mapstore/store/vehicle_rows.h"

#include <fmt/format.h>

#include <string>
#include <tuple>
#include <utility>

#include "mapstore/sqlite/row_checksum.h"

namespace shiftmap {
namespace {

// `vehicle, runs, stamp_ns` and the values.
std::string Columns() {
  std::string columns = "vehicle, runs, stamp_ns";
  for (const char* name : kVehicleValueNames) columns += fmt::format(", {}", name);
  return columns;
}

}  // namespace

Status InsertVehicleRows(Database& database,
                         std::int64_t version_id,
                         const std::vector<VehicleCalibration>& vehicles) {
  if (vehicles.empty()) return OkStatus();
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement row,
      database.Prepare(InsertRowSql("vehicle_calibration", "version_id, " + Columns())));
  for (const VehicleCalibration& vehicle : vehicles) {
    std::apply(
        [&](const auto&... values) {
          row.Bind(
              version_id, vehicle.vehicle, vehicle.runs, ToNanoseconds(vehicle.stamp), values...);
        },
        VehicleValues(vehicle));
    SHIFTMAP_RETURN_IF_ERROR(row.Execute());
  }
  return OkStatus();
}

Status ReadVehicleRows(Database& database,
                       std::int64_t version_id,
                       std::vector<VehicleCalibration>& vehicles) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement rows,
      database.Prepare(fmt::format(
          "SELECT {} FROM vehicle_calibration WHERE version_id = ?1 ORDER BY vehicle", Columns())));
  rows.Bind(version_id);
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, rows.Step());
    if (!row) return OkStatus();
    VehicleCalibration vehicle;
    vehicle.vehicle = rows.Text(0);
    vehicle.runs = rows.Int64(1);
    vehicle.stamp = StampFromNanoseconds(rows.Int64(2));
    int column = 3;
    for (double* value : VehicleValues(&vehicle)) *value = rows.Double(column++);
    vehicles.push_back(std::move(vehicle));
  }
}

}  // namespace shiftmap
