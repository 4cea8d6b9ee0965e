// SPDX-License-Identifier: Apache-2.0
#include "tools/inspect/plot_pictures.h"

#include <algorithm>
#include <optional>

#include "tools/plot/map_plot.h"

namespace shiftmap {
namespace {

// Of a long line of versions, only the newest are looked into.
constexpr std::size_t kMostVersions = 400;

Json AboutMap(const MapSnapshot& map) {
  return {{"area", map.area()}, {"version", map.version().value()}};
}

// The runs that the ancestors of a version were built from.
StatusOr<std::vector<RunRecord>> EarlierRuns(const std::string& area,
                                             VersionNumber version,
                                             MapStore* store) {
  SHIFTMAP_ASSIGN_OR_RETURN(const auto versions, store->Versions(area));
  std::vector<RunRecord> runs;
  std::optional<VersionNumber> at = version;
  for (std::size_t i = 0; i < kMostVersions; ++i) {
    const auto summary = std::find_if(versions.begin(), versions.end(), [&](const auto& candidate) {
      return candidate.version == *at;
    });
    if (summary == versions.end() || !summary->parent) break;
    at = summary->parent;
    SHIFTMAP_ASSIGN_OR_RETURN(const Provenance provenance, store->LoadProvenance(area, *at));
    runs.insert(runs.end(), provenance.runs.begin(), provenance.runs.end());
  }
  return runs;
}

}  // namespace

StatusOr<Picture> DrawMap(const PictureArguments& arguments, const Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, OpenStore(arguments.store, context));
  SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot map, LoadMap(arguments.store, &store));
  SHIFTMAP_ASSIGN_OR_RETURN(const Provenance provenance,
                            store.LoadProvenance(map.area(), map.version()));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<RunRecord> earlier,
                            EarlierRuns(map.area(), map.version(), &store));
  return Picture{PlotMap(map, provenance.runs, earlier), AboutMap(map)};
}

}  // namespace shiftmap
