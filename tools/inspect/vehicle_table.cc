// SPDX-License-Identifier: Apache-2.0
#include "tools/inspect/vehicle_table.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <utility>

#include "mapstore/cli/aligned_table.h"
#include "mapstore/core/inert_text.h"
#include "tools/inspect/store_arguments.h"

namespace shiftmap {
namespace {

struct NamedInterval {
  const char* name;
  Interval interval;
};

// Noise that no run told of is left out.
std::vector<NamedInterval> IntervalsOf(const VehicleCalibration& vehicle) {
  std::vector<NamedInterval> intervals = {
      {"scale_v", Exponential(IntervalOf(vehicle.log_scale_v))},
      {"scale_omega", Exponential(IntervalOf(vehicle.log_scale_omega))},
      {"lag_s", IntervalOf(vehicle.lag_s)},
      {"bearing_offset_rad", IntervalOf(vehicle.bearing_offset_rad)},
      {"range_curvature_per_rad2", IntervalOf(vehicle.range_curvature_per_rad2)}};
  const std::pair<const char*, NoiseEstimate> noises[] = {{"noise_v", vehicle.noise_v},
                                                          {"noise_omega", vehicle.noise_omega},
                                                          {"sd_range_m", vehicle.range_m},
                                                          {"sd_bearing_rad", vehicle.bearing_rad},
                                                          {"sd_position_m", vehicle.position_m}};
  for (const auto& [name, noise] : noises) {
    if (noise.known()) intervals.push_back({name, IntervalOf(noise)});
  }
  intervals.push_back({"detection_probability", IntervalOf(vehicle.detection)});
  return intervals;
}

}  // namespace

Json VehiclesJson(const std::vector<VehicleCalibration>& vehicles) {
  Json list = Json::array();
  for (const VehicleCalibration& vehicle : vehicles) {
    Json entry = {{"vehicle", vehicle.vehicle},
                  {"runs", vehicle.runs},
                  {"stamp_s", ToSecondsSinceEpoch(vehicle.stamp)}};
    for (const auto& [name, interval] : IntervalsOf(vehicle)) {
      entry[name] = {{"value", interval.value}, {"interval_95", {interval.low, interval.high}}};
    }
    list.push_back(std::move(entry));
  }
  return list;
}

std::string VehiclesText(const std::vector<VehicleCalibration>& vehicles, const TextStyle& style) {
  if (vehicles.empty()) return "no vehicle is calibrated by itself\n";
  AlignedTable table({"vehicle", "what", "value", "low", "high", "runs", "newest"});
  for (const VehicleCalibration& vehicle : vehicles) {
    for (const auto& [name, interval] : IntervalsOf(vehicle)) {
      table.AddRow({vehicle.vehicle,
                    name,
                    fmt::format("{:.4f}", interval.value),
                    fmt::format("{:.4f}", interval.low),
                    fmt::format("{:.4f}", interval.high),
                    fmt::format("{}", vehicle.runs),
                    TimeText(vehicle.stamp)});
    }
  }
  return table.ToString(style, "no vehicles");
}

Json TrustJson(const std::vector<VehicleTrust>& trust) {
  Json json = Json::array();
  for (const VehicleTrust& vehicle : trust) {
    json.push_back({{"vehicle", vehicle.vehicle}, {"broken", vehicle.broken}});
  }
  return json;
}

std::string TrustText(const std::vector<VehicleTrust>& trust) {
  std::string text;
  for (const VehicleTrust& vehicle : trust) {
    if (!IsDistrusted(vehicle)) continue;
    text +=
        fmt::format("'{}' contradicts the others and is not believed, with probability {:.3f}\n",
                    InertLine(vehicle.vehicle),
                    vehicle.broken);
  }
  return text;
}

}  // namespace shiftmap
