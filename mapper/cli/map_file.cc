// SPDX-License-Identifier: Apache-2.0
#include "mapper/cli/map_file.h"

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <map>
#include <nlohmann/json.hpp>
#include <string_view>
#include <utility>

#include "mapper/cli/survey_file.h"
#include "mapstore/codec/map_message.h"
#include "mapstore/core/input_file.h"
#include "mapstore/core/stamp_check.h"

namespace shiftmap {
namespace {

using nlohmann::json;

constexpr std::string_view kInMapFrame = "metres in the map frame";

// Beyond it a stamp does not fit into nanoseconds.
constexpr double kMaxStampS = 9.2e9;

StatusOr<double> Number(const json& object, const char* key) {
  const auto found = object.find(key);
  if (found == object.end() || !found->is_number()) return InvalidArgument("no number '{}'", key);
  return found->get<double>();
}

StatusOr<double> NumberOr(const json& object, const char* key, double otherwise) {
  return object.contains(key) ? Number(object, key) : otherwise;
}

// Numbers of an array, as many as there have to be.
StatusOr<std::vector<double>> Numbers(const json& object, const char* key, std::size_t count) {
  const auto found = object.find(key);
  std::vector<double> numbers;
  if (found != object.end() && found->is_array()) {
    for (const json& value : *found) {
      if (value.is_number()) numbers.push_back(value.get<double>());
    }
  }
  if (numbers.size() == count && found->size() == count) return numbers;
  return InvalidArgument("'{}' is not {} numbers", key, count);
}

// Whole seconds and the rest apart: a product would lose some hundred nanoseconds.
StatusOr<Stamp> StampOr(const json& object, const char* key, Stamp otherwise) {
  SHIFTMAP_ASSIGN_OR_RETURN(const double seconds,
                            NumberOr(object, key, ToSecondsSinceEpoch(otherwise)));
  if (!(std::abs(seconds) < kMaxStampS)) return InvalidArgument("{}: {}", key, seconds);
  const double whole = std::floor(seconds);
  return StampFromSeconds(whole) + FromSeconds(seconds - whole);
}

const json& Member(const json& object, const char* key) {
  static const json kNothing = json::object();
  const auto found = object.find(key);
  return found != object.end() && found->is_object() ? *found : kNothing;
}

// The map that a FeatureCollection describes.
class GeoJsonMap {
 public:
  explicit GeoJsonMap(double leave_rate_per_s) : leave_rate_per_s_(leave_rate_per_s) {}

  Status Take(const json& feature) {
    if (!feature.is_object()) return InvalidArgument("no object");
    SHIFTMAP_ASSIGN_OR_RETURN(Mode mode, TakeMode(feature));
    const json& properties = Member(feature, "properties");
    if (!properties.contains("signature")) {
      mode.number = ModeNumber(static_cast<std::int64_t>(anonymous_landmarks_.size()) + 1);
      anonymous_landmarks_.push_back(mode);
      return OkStatus();
    }
    const json& signature = properties["signature"];
    if (!signature.is_string()) return InvalidArgument("signature is no text");
    const auto number = properties.find("mode");
    if (number == properties.end() || !number->is_number_integer()) {
      return InvalidArgument("no integer 'mode'");
    }
    mode.number = ModeNumber(number->get<std::int64_t>());
    if (mode.number.value() < 1) {
      return InvalidArgument("mode {}, expected 1 or more", mode.number.value());
    }
    SHIFTMAP_ASSIGN_OR_RETURN(const double probability, Number(properties, "probability"));
    SurveyGroup& group = groups_[Signature(signature.get<std::string>())];
    SHIFTMAP_ASSIGN_OR_RETURN(group.leave_rate_per_s,
                              NumberOr(properties, "leave_rate_per_s", leave_rate_per_s_));
    if (!(group.leave_rate_per_s >= 0.0)) {
      return InvalidArgument("leave_rate_per_s: {}, expected 0 or more", group.leave_rate_per_s);
    }
    return group.Add({mode, probability});
  }

  StatusOr<MapContent> Make(Stamp stamp) && {
    return MakeSurveyMap(groups_, stamp, std::move(anonymous_landmarks_));
  }

 private:
  static StatusOr<Mode> TakeMode(const json& feature) {
    const json& geometry = Member(feature, "geometry");
    if (geometry.value("type", json()) != json("Point")) {
      return InvalidArgument("geometry is no Point");
    }
    const json& properties = Member(feature, "properties");
    SHIFTMAP_ASSIGN_OR_RETURN(const auto position, Numbers(geometry, "coordinates", 2));
    SHIFTMAP_ASSIGN_OR_RETURN(const auto cov, Numbers(properties, "cov_m2", 3));
    Mode mode;
    mode.p_map_landmark = {position[0], position[1]};
    mode.cov_p_map_landmark << cov[0], cov[1], cov[1], cov[2];
    SHIFTMAP_ASSIGN_OR_RETURN(mode.last_seen, StampOr(properties, "last_seen_s", Stamp()));
    return mode;
  }

  double leave_rate_per_s_;
  std::map<Signature, SurveyGroup> groups_;
  std::vector<Mode> anonymous_landmarks_;
};

StatusOr<MapContent> ParseGeoJson(std::string_view text, const MapFileOptions& options) {
  const json document = json::parse(text, nullptr, /*allow_exceptions=*/false);
  if (!document.is_object() || document.value("type", json()) != json("FeatureCollection") ||
      !document.contains("features") || !document["features"].is_array()) {
    return InvalidArgument("no GeoJSON FeatureCollection");
  }
  if (document.value("coordinates", json()) != json(kInMapFrame)) {
    return InvalidArgument(
        "coordinates may be degrees: expected the member \"coordinates\": \"{}\"", kInMapFrame);
  }
  GeoJsonMap map(options.leave_rate_per_s);
  std::size_t index = 0;
  for (const json& feature : document["features"]) {
    if (const Status status = map.Take(feature); !status.ok()) {
      return InvalidArgument("feature {}: {}", index, Message(status));
    }
    ++index;
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const Stamp stamp, StampOr(document, "stamp_s", options.now));
  return std::move(map).Make(options.stamp.value_or(stamp));
}

StatusOr<MapContent> ParseMessage(std::string_view text,
                                  MapForm form,
                                  const MapFileOptions& options) {
  SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot map, DecodeMap(text, form));
  MapContent content = map.content();
  if (content.stamp == Stamp()) content.stamp = options.now;
  if (options.stamp) content.stamp = *options.stamp;
  return content;
}

std::string FormatOf(const std::string& path, const std::string& format) {
  if (format != "auto") return format;
  if (path.ends_with(".geojson")) return "geojson";
  if (path.ends_with(".textproto")) return "textproto";
  return path.ends_with(".json") || path.ends_with(".protojson") ? "protojson" : "csv";
}

}  // namespace

const std::vector<std::string>& MapFileFormats() {
  static const std::vector<std::string> kFormats = {
      "auto", "csv", "geojson", "textproto", "protojson"};
  return kFormats;
}

StatusOr<MapContent> ReadMapFile(const std::string& path, const MapFileOptions& options) {
  const std::string format = FormatOf(path, options.format);
  if (format == "csv") {
    return ReadSurvey(path, options.stamp.value_or(options.now), options.leave_rate_per_s);
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const std::string text, ReadInputFile("map file", path));
  StatusOr<MapContent> content =
      format == "geojson"
          ? ParseGeoJson(text, options)
          : ParseMessage(text, format == "textproto" ? MapForm::kText : MapForm::kJson, options);
  if (!content.ok()) return InvalidArgument("map file '{}': {}", path, Message(content.status()));
  if (content->groups.empty()) return InvalidArgument("map file '{}': no landmarks", path);
  return content;
}

}  // namespace shiftmap
