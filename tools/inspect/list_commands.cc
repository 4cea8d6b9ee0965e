// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <memory>
#include <nlohmann/json.hpp>
#include <vector>

#include "mapstore/cli/aligned_table.h"
#include "tools/inspect/inspect_commands.h"
#include "tools/inspect/store_arguments.h"

namespace shiftmap {
namespace {

Json VersionJson(const std::optional<VersionNumber>& version) {
  return version ? Json(version->value()) : Json(nullptr);
}

std::string VersionText(const std::optional<VersionNumber>& version) {
  return version ? fmt::format("{}", version->value()) : "-";
}

Status RunAreas(const StoreArguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, OpenStore(arguments, context));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<AreaSummary> areas, store.Areas());
  Json list = Json::array();
  AlignedTable table({"area", "published", "versions"});
  for (const AreaSummary& area : areas) {
    list.push_back({{"area", area.area},
                    {"published", VersionJson(area.published)},
                    {"versions", area.versions}});
    table.AddRow({area.area, VersionText(area.published), fmt::format("{}", area.versions)});
  }
  context.Report({{"areas", list}}, table.ToString(context.style(), "no areas"));
  return OkStatus();
}

Status RunVersions(const StoreArguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, OpenStore(arguments, context));
  SHIFTMAP_ASSIGN_OR_RETURN(const auto versions, store.Versions(arguments.area));
  Json list = Json::array();
  AlignedTable table({"version", "parent", "published", "created", "stored", "content", "tool"});
  for (const VersionSummary& version : versions) {
    list.push_back({{"version", version.version.value()},
                    {"parent", VersionJson(version.parent)},
                    {"content_hash", version.content_hash},
                    {"published", version.published},
                    {"stored", version.content_stored},
                    {"stamp_s", ToSecondsSinceEpoch(version.stamp)},
                    {"created_s", ToSecondsSinceEpoch(version.created)},
                    {"tool", version.tool}});
    table.AddRow({VersionText(version.version),
                  VersionText(version.parent),
                  version.published ? "yes" : "",
                  TimeText(version.created),
                  version.content_stored ? "yes" : "no",
                  ShortHash(version.content_hash),
                  version.tool},
                 version.published ? Emphasis::kStrong : Emphasis::kNone);
  }
  context.Report({{"versions", list}}, table.ToString(context.style(), "no versions"));
  return OkStatus();
}

struct SightingArguments : StoreArguments {
  bool all = false;
  std::optional<double> since_s;
};

// Whether a map has a mode of the landmark where it was seen.
bool Explains(const MapSnapshot& map, const UnmappedSighting& sighting) {
  const int group = map.GroupIndex(sighting.signature);
  const bool anonymous = sighting.signature.anonymous();
  if (!anonymous && group < 0) return false;
  const std::vector<Mode>& modes =
      anonymous ? map.anonymous_landmarks() : map.groups()[static_cast<std::size_t>(group)].modes;
  return std::any_of(modes.begin(), modes.end(), [&](const Mode& mode) {
    return Gates(sighting, mode.p_map_landmark, mode.cov_p_map_landmark);
  });
}

// The nearest mode of the landmark, and how far it is; nothing if the map does not have it.
struct NearestMode {
  ModeNumber number;
  double distance_m = 0.0;
};

std::optional<NearestMode> NearestOf(const MapSnapshot& map, const UnmappedSighting& sighting) {
  const int group = map.GroupIndex(sighting.signature);
  if (group < 0) return std::nullopt;
  std::optional<NearestMode> nearest;
  for (const Mode& mode : map.groups()[static_cast<std::size_t>(group)].modes) {
    const double distance_m = (mode.p_map_landmark - sighting.p_map_landmark).norm();
    if (!nearest || distance_m < nearest->distance_m) nearest = {mode.number, distance_m};
  }
  return nearest;
}

Status RunSightings(const SightingArguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, OpenStore(arguments, context));
  SHIFTMAP_ASSIGN_OR_RETURN(std::vector<UnmappedSighting> sightings,
                            store.Sightings(arguments.area));
  SHIFTMAP_ASSIGN_OR_RETURN(const auto published, store.PublishedVersion(arguments.area));
  std::optional<MapSnapshot> map;
  if (published) {
    SHIFTMAP_ASSIGN_OR_RETURN(map, store.LoadVersion(arguments.area, *published));
  }
  std::erase_if(sightings, [&](const UnmappedSighting& sighting) {
    const bool old = arguments.since_s && sighting.last < StampFromSeconds(*arguments.since_s);
    return old || (map && !arguments.all && Explains(*map, sighting));
  });
  Json list = Json::array();
  AlignedTable table(
      {"signature", "x_m", "y_m", "count", "last", "distance_m", "nearest_mode", "first"});
  for (const UnmappedSighting& sighting : sightings) {
    const Eigen::Matrix2d& cov = sighting.cov_p_map_landmark;
    const std::optional<NearestMode> nearest = map ? NearestOf(*map, sighting) : std::nullopt;
    list.push_back({{"signature", sighting.signature.text()},
                    {"x_m", sighting.p_map_landmark.x()},
                    {"y_m", sighting.p_map_landmark.y()},
                    {"cov_m2", {cov(0, 0), cov(0, 1), cov(1, 1)}},
                    {"count", sighting.count},
                    {"first_s", ToSecondsSinceEpoch(sighting.first)},
                    {"last_s", ToSecondsSinceEpoch(sighting.last)},
                    {"nearest_mode", nearest ? Json(nearest->number.value()) : Json(nullptr)},
                    {"distance_m", nearest ? Json(nearest->distance_m) : Json(nullptr)}});
    table.AddRow({sighting.signature.text(),
                  fmt::format("{:.2f}", sighting.p_map_landmark.x()),
                  fmt::format("{:.2f}", sighting.p_map_landmark.y()),
                  fmt::format("{}", sighting.count),
                  TimeText(sighting.last),
                  nearest ? fmt::format("{:.2f}", nearest->distance_m) : "-",
                  nearest ? fmt::format("{}", nearest->number.value()) : "-",
                  TimeText(sighting.first)});
  }
  context.Report({{"area", arguments.area}, {"sightings", list}},
                 table.ToString(context.style(), "no sightings that the map does not explain"));
  return OkStatus();
}

}  // namespace

void AddListCommands(Application* application) {
  auto areas = std::make_shared<StoreArguments>();
  application
      ->AddCommand("areas",
                   "List the areas of a store",
                   [areas](Context& context) { return RunAreas(*areas, context); })
      .Option("--store", &areas->store, "Map store")
      .Required()
      .Watchable();

  auto versions = std::make_shared<StoreArguments>();
  Command& versions_command = application->AddCommand(
      "versions", "List the map versions of an area", [versions](Context& context) {
        return RunVersions(*versions, context);
      });
  AddStoreOptions(versions.get(), &versions_command);
  versions_command.Watchable();

  auto sightings = std::make_shared<SightingArguments>();
  Command& sightings_command = application->AddCommand(
      "sightings", "List what shifts saw where the map has no mode", [sightings](Context& context) {
        return RunSightings(*sightings, context);
      });
  AddStoreOptions(sightings.get(), &sightings_command);
  sightings_command.Flag("--all", &sightings->all, "Also where the published map has a mode by now")
      .Time("--since", &sightings->since_s, "Of which the last is not older")
      .Watchable();

  application->AddConfigCommand();
}

}  // namespace shiftmap
