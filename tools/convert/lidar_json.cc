// SPDX-License-Identifier: Apache-2.0
#include "tools/convert/lidar_json.h"

#include <algorithm>
#include <cstddef>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <utility>

#include "mapstore/core/input_file.h"
#include "tools/convert/decimal.h"

namespace shiftmap {
namespace {

using Json = nlohmann::json;

struct PosedScan {
  StampedPose pose;
  std::vector<double> ranges_m;
};

StatusOr<double> NumberOf(const Json& scan, const char* key) {
  const auto value = scan.find(key);
  if (value == scan.end()) return InvalidArgument("no '{}'", key);
  if (!value->is_number()) {
    return InvalidArgument("'{}' is of type {}, expected a number", key, value->type_name());
  }
  return value->get<double>();
}

StatusOr<PosedScan> ToScan(const std::string& time, const Json& scan) {
  PosedScan out;
  SHIFTMAP_ASSIGN_OR_RETURN(out.pose.stamp, ParseStamp(time));
  if (!scan.is_object()) {
    return InvalidArgument("is of type {}, expected an object", scan.type_name());
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const double x_m, NumberOf(scan, "x"));
  SHIFTMAP_ASSIGN_OR_RETURN(const double y_m, NumberOf(scan, "y"));
  SHIFTMAP_ASSIGN_OR_RETURN(const double yaw_rad, NumberOf(scan, "theta"));
  out.pose.T_map_vehicle = Se2(x_m, y_m, yaw_rad);
  const auto ranges = scan.find("range");
  if (ranges == scan.end() || !ranges->is_array() || ranges->size() < 2) {
    return InvalidArgument("'range' is no array of two numbers or more");
  }
  for (const Json& range : *ranges) {
    if (!range.is_number()) {
      return InvalidArgument("'range' has a {}, expected numbers", range.type_name());
    }
    out.ranges_m.push_back(range.get<double>());
  }
  return out;
}

// Line and column of a byte, both from 1.
std::pair<std::ptrdiff_t, std::size_t> PlaceOf(const std::string& text, std::size_t byte) {
  const std::string_view before = std::string_view(text).substr(0, byte);
  const std::size_t line_end = before.rfind('\n');
  return {1 + std::count(before.begin(), before.end(), '\n'),
          before.size() - (line_end == std::string_view::npos ? 0 : line_end + 1) + 1};
}

StatusOr<Json> ParseJson(const std::string& path, const std::string& text) {
  try {
    return Json::parse(text);
  } catch (const Json::parse_error& error) {
    const auto [line, column] = PlaceOf(text, error.byte > 0 ? error.byte - 1 : 0);
    return InvalidArgument("{}:{}: no JSON at column {}", path, line, column);
  } catch (const Json::exception&) {
    return InvalidArgument("file '{}': a number of its JSON is out of range", path);
  }
}

}  // namespace

StatusOr<LidarLog> ReadLidarJson(const std::string& path) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::string text, ReadInputFile("file", path));
  SHIFTMAP_ASSIGN_OR_RETURN(const Json document, ParseJson(path, text));
  const auto map = document.find("map");
  if (map == document.end() || !map->is_object()) {
    return InvalidArgument("file '{}': no object 'map' at its top", path);
  }
  std::vector<PosedScan> scans;
  for (const auto& [time, scan] : map->items()) {
    auto posed = ToScan(time, scan);
    if (!posed.ok()) {
      return InvalidArgument("file '{}': scan '{}': {}", path, time, Message(posed.status()));
    }
    scans.push_back(*std::move(posed));
  }
  std::sort(scans.begin(), scans.end(), [](const PosedScan& a, const PosedScan& b) {
    return a.pose.stamp < b.pose.stamp;
  });
  LidarLog log;
  log.name = std::filesystem::path(path).filename().string();
  for (PosedScan& scan : scans) {
    if (!log.poses.empty() && log.poses.back().stamp == scan.pose.stamp) {
      return InvalidArgument(
          "file '{}': two scans at {:.6f}", path, ToSecondsSinceEpoch(scan.pose.stamp));
    }
    log.poses.push_back(scan.pose);
    log.scans.push_back({scan.pose.stamp, std::move(scan.ranges_m)});
  }
  return log;
}

}  // namespace shiftmap
