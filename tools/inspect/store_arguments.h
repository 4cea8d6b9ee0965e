// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

#include "mapstore/cli/command.h"
#include "mapstore/cli/context.h"
#include "mapstore/map_store.h"
#include "tools/plot/change_plot.h"

namespace shiftmap {

/// Which store, and which map in it, a command looks at.
struct StoreArguments {
  std::string store;
  std::string area;
  std::optional<std::int64_t> version;
  std::optional<double> at_s;
  std::optional<double> known_s;
};

/// Adds --store and --area; the arguments must outlive the run.
/// @param required  False: the command checks by itself whether it needs them.
void AddStoreOptions(StoreArguments* arguments, Command* command, bool required = true);

/// The usage error of a command without --area, with the areas of the store; nothing if it has one.
std::string MissingArea(const StoreArguments& arguments);

/// Adds --version and --at too.
void AddMapOptions(StoreArguments* arguments, Command* command, bool required = true);

/// Adds --known, which LoadMap follows.
void AddKnownOption(StoreArguments* arguments, Command* command);

/// Opens the store for reading.
StatusOr<MapStore> OpenStore(const StoreArguments& arguments, const Context& context);

/// The version that the arguments name, or the published one.
/// Errors: kNotFound if the area has no published version.
StatusOr<VersionNumber> SelectVersion(const StoreArguments& arguments, MapStore* store);

/// The map that the arguments name, at the time they name, as it was known at the time they name;
/// without one, by this host's clock. Warns as WarnOfEarlierTime.
StatusOr<MapSnapshot> LoadMap(const StoreArguments& arguments,
                              MapStore* store,
                              const Context& context);

/// Warns if --at is before the version that was loaded: a version tells of no time before its
/// newest run.
/// @param stamp  Of the probabilities that were loaded.
void WarnOfEarlierTime(const StoreArguments& arguments, Stamp stamp, const Context& context);

/// Whether a sighting may be of a landmark that stands at a position: within the 99.9 % gate.
bool Gates(const UnmappedSighting& sighting,
           const Eigen::Vector2d& p_map_landmark,
           const Eigen::Matrix2d& cov_p_map_landmark);

/// The parent of a version; nothing if it has none, or the area does not have the version.
StatusOr<std::optional<VersionNumber>> ParentOf(const std::string& area,
                                                VersionNumber version,
                                                MapStore* store);

/// The index of a landmark in MapSnapshot::groups.
/// Errors: kNotFound, with the nearest name that the map has instead.
StatusOr<std::size_t> FindLandmark(const MapSnapshot& map, const std::string& signature);

/// A status that is not OK; if that is because the map of the arguments does not have the landmark,
/// the one of FindLandmark() instead.
Status NameLandmark(const Status& status,
                    const StoreArguments& arguments,
                    const std::string& signature,
                    MapStore* store,
                    const Context& context);

/// A version with the probabilities of the time at which it was built.
/// Errors: as MapStore::LoadAt.
StatusOr<MapSnapshot> LoadAsBuilt(const std::string& area, VersionNumber version, MapStore* store);

/// A version as it was built, carried to another one that it is compared with.
StatusOr<EarlierMap> LoadEarlier(VersionNumber version, const MapSnapshot& to, MapStore* store);

/// As many digits of a hash as people need.
std::string ShortHash(const std::string& hash);

/// FormatUtc(); a dash for the epoch, which stands for never.
std::string TimeText(Stamp stamp);

/// What the next build does, for a line about what was taken out of the area's published version.
/// @param goes_on  The text where a version is left to go on from.
StatusOr<std::string> NextBuildText(const std::string& area,
                                    const std::string& goes_on,
                                    MapStore* store);

}  // namespace shiftmap
