// SPDX-License-Identifier: Apache-2.0
#include "tools/inspect/store_arguments.h"

#include <fmt/ranges.h>

#include "mapstore/cli/store_access.h"
#include "mapstore/core/clock.h"
#include "mapstore/core/inert_text.h"
#include "mapstore/core/nearest_name.h"
#include "mapstore/find_version.h"
#include "mapstore/geometry/covariance.h"
#include "mapstore/map/frame_change.h"
#include "mapstore/prior_version.h"

namespace shiftmap {

void AddStoreOptions(StoreArguments* arguments, Command* command, bool required) {
  command->Option("--store", &arguments->store, "Map store, or a snapshot of one area");
  if (required) command->Required();
  command->Option("--area", &arguments->area, required ? "Area; required" : "Area");
  if (required) command->Check([arguments] { return MissingArea(*arguments); });
}

std::string MissingArea(const StoreArguments& arguments) {
  if (!arguments.area.empty()) return "";
  std::vector<std::string> names;
  StatusOr<MapStore> store = MapStore::Open(arguments.store, MapStore::Access::kReadOnly);
  const auto areas = store.ok() ? store->Areas() : store.status();
  if (areas.ok()) {
    for (const AreaSummary& area : *areas)
      names.push_back(fmt::format("'{}'", InertLine(area.area)));
  }
  if (names.empty()) return "--area is required";
  return fmt::format("--area is required, one of {}", fmt::join(names, ", "));
}

void AddMapOptions(StoreArguments* arguments, Command* command, bool required) {
  AddStoreOptions(arguments, command, required);
  command->Option("--version", &arguments->version, "Map version (default: the published one)");
  command->Time("--at", &arguments->at_s, "Time of the probabilities (default: now)");
}

void AddKnownOption(StoreArguments* arguments, Command* command) {
  command->Time("--known", &arguments->known_s, "What was known at a time (default: now)");
}

StatusOr<MapStore> OpenStore(const StoreArguments& arguments, const Context& context) {
  return OpenStore(arguments.store, MapStore::Access::kReadOnly, context);
}

StatusOr<VersionNumber> SelectVersion(const StoreArguments& arguments, MapStore* store) {
  if (arguments.version) return VersionNumber(*arguments.version);
  SHIFTMAP_ASSIGN_OR_RETURN(const auto published, store->PublishedVersion(arguments.area));
  if (!published) {
    SHIFTMAP_RETURN_IF_ERROR(store->Versions(arguments.area).status());
    return NotFound(
        "map store '{}': area '{}' has no published version", arguments.store, arguments.area);
  }
  return *published;
}

void WarnOfEarlierTime(const StoreArguments& arguments, Stamp stamp, const Context& context) {
  if (!arguments.at_s) return;
  const Stamp at = StampFromSeconds(*arguments.at_s);
  // A time in seconds has less digits than a stamp.
  if (at + FromSeconds(1e-3) >= stamp) return;
  context.Warn(fmt::format(
      "--at {}: the version tells of no time before {} UTC; --known gives what was known then",
      FormatUtc(at),
      FormatUtc(stamp)));
}

StatusOr<MapSnapshot> LoadMap(const StoreArguments& arguments,
                              MapStore* store,
                              const Context& context) {
  std::optional<VersionNumber> version;
  if (arguments.version) version = VersionNumber(*arguments.version);
  const Stamp now = arguments.known_s ? StampFromSeconds(*arguments.known_s) : SystemNow();
  const Stamp at = arguments.at_s ? StampFromSeconds(*arguments.at_s) : now;
  StatusOr<MapSnapshot> map = arguments.known_s ? store->LoadKnown(arguments.area, now, version, at)
                                                : store->LoadAt(arguments.area, version, at);
  if (map.ok()) WarnOfEarlierTime(arguments, map->stamp(), context);
  return map;
}

bool Gates(const UnmappedSighting& sighting,
           const Eigen::Vector2d& p_map_landmark,
           const Eigen::Matrix2d& cov_p_map_landmark) {
  static const double kGate = ChiSquareQuantile(0.999, 2);
  return SquaredMahalanobis(sighting.p_map_landmark - p_map_landmark,
                            sighting.cov_p_map_landmark + cov_p_map_landmark) < kGate;
}

StatusOr<std::optional<VersionNumber>> ParentOf(const std::string& area,
                                                VersionNumber version,
                                                MapStore* store) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<VersionSummary> versions, store->Versions(area));
  return ParentOf(versions, version);
}

StatusOr<std::size_t> FindLandmark(const MapSnapshot& map, const std::string& signature) {
  const int index = map.GroupIndex(Signature(signature));
  if (index >= 0) return static_cast<std::size_t>(index);
  std::vector<std::string> names;
  for (const LandmarkGroup& group : map.groups()) names.push_back(group.signature.text());
  return NotFound("area '{}': version {} has no landmark '{}'{}",
                  map.area(),
                  map.version().value(),
                  signature,
                  DidYouMean(signature, names));
}

Status NameLandmark(const Status& status,
                    const StoreArguments& arguments,
                    const std::string& signature,
                    MapStore* store,
                    const Context& context) {
  if (status.code() != StatusCode::kNotFound) return status;
  const StatusOr<MapSnapshot> map = LoadMap(arguments, store, context);
  if (!map.ok()) return status;
  const Status found = FindLandmark(*map, signature).status();
  return found.ok() ? status : found;
}

StatusOr<MapSnapshot> LoadAsBuilt(const std::string& area, VersionNumber version, MapStore* store) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<VersionSummary> versions, store->Versions(area));
  const VersionSummary* const summary = FindVersion(versions, version);
  return store->LoadAt(
      area, version, summary == nullptr ? std::nullopt : std::optional(summary->stamp));
}

StatusOr<EarlierMap> LoadEarlier(VersionNumber version, const MapSnapshot& to, MapStore* store) {
  SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot from, LoadAsBuilt(to.area(), version, store));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<MapEdit> from_edits,
                            store->EditsOf(to.area(), version));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<MapEdit> to_edits,
                            store->EditsOf(to.area(), to.version()));
  CarriedMap carried =
      CarryMap(from.content(), LandmarkNames(from_edits), to.content(), LandmarkNames(to_edits));
  return EarlierMap{
      MapSnapshot(from.area(), version, from.content_hash(), std::move(carried.content)),
      std::move(carried.renamed),
      carried.moved};
}

std::string ShortHash(const std::string& hash) { return hash.substr(0, 12); }

std::string TimeText(Stamp stamp) { return stamp == Stamp() ? "-" : FormatUtc(stamp); }

StatusOr<std::string> NextBuildText(const std::string& area,
                                    const std::string& goes_on,
                                    MapStore* store) {
  SHIFTMAP_ASSIGN_OR_RETURN(const auto published, store->PublishedVersion(area));
  if (!published) return goes_on;
  SHIFTMAP_ASSIGN_OR_RETURN(const auto prior, FindPriorVersion(area, *published, nullptr, store));
  if (prior) return goes_on;
  return std::string(
      "no stored ancestor is without it, builds start anew from the logs that are there (nightly, "
      "or shiftmap-mapper build --prior none)");
}

}  // namespace shiftmap
