// SPDX-License-Identifier: Apache-2.0
#include "mapper/cli/prior_map.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <set>
#include <string>

#include "mapstore/cli/store_access.h"
#include "mapstore/find_version.h"
#include "mapstore/prior_version.h"

namespace shiftmap {
namespace {

// Goes on from the edits that are in force. A prior that is named is taken as it is.
Status TakeEditsIn(const AreaBuildOptions& options,
                   const Context& context,
                   MapStore* store,
                   PriorMap* prior) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<MapEdit> edits, store->Edits(options.area));
  if (edits.empty()) return OkStatus();
  if (prior->published && !context.dry_run()) {
    SHIFTMAP_ASSIGN_OR_RETURN(
        MapStore writer,
        OpenStore(options.store, MapStore::Access::kReadWrite, context, options.clock_tolerance_s));
    SHIFTMAP_ASSIGN_OR_RETURN(prior->version,
                              writer.WithEditsInForce(options.area, *prior->version));
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<MapEdit> held,
                            store->EditsOf(options.area, *prior->version));
  prior->edits = MakeBuildEdits(held);
  prior->stated_places = StatedPlaces(edits, held);
  return OkStatus();
}

// Runs of the published version's line that its prior does not rest on, but for excluded ones.
Status FindFallenOut(const AreaBuildOptions& options, MapStore* store, PriorMap* prior) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<VersionSummary> versions,
                            store->Versions(options.area));
  for (std::optional<VersionNumber> at = prior->published; at && *at != *prior->version;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const Provenance provenance,
                              store->LoadProvenance(options.area, *at));
    for (const RunRecord& run : provenance.runs) {
      const bool rests =
          std::any_of(prior->known_runs.begin(), prior->known_runs.end(), [&](const LineRun& of) {
            return of.run.sha256 == run.sha256;
          });
      const bool excluded = FindExclusion(prior->exclusions, run) != nullptr;
      if (!rests && !excluded) prior->fallen_out.push_back(run);
    }
    at = ParentOf(versions, *at);
  }
  return OkStatus();
}

// The newest runs of a version and its ancestors, with their trajectories.
// @param without_runs  Hashes and identities.
StatusOr<std::vector<RunRecord>> LoadOlderRuns(const std::string& area,
                                               VersionNumber version,
                                               const std::set<std::string>& without_runs,
                                               MapStore* store) {
  constexpr std::size_t kMostRuns = 500;
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<VersionSummary> versions, store->Versions(area));
  std::vector<RunRecord> runs;
  for (std::optional<VersionNumber> at = version; at && runs.size() < kMostRuns;
       at = ParentOf(versions, *at)) {
    SHIFTMAP_ASSIGN_OR_RETURN(const Provenance provenance, store->LoadProvenance(area, *at));
    for (const RunRecord& run : provenance.runs) {
      if (run.trajectory.empty() || without_runs.contains(run.sha256) ||
          without_runs.contains(run.identity())) {
        continue;
      }
      runs.push_back(run);
    }
  }
  return runs;
}

// Two names that differ by case alone are seldom two places.
void WarnOfAlike(const std::string& area,
                 const std::vector<AreaSummary>& areas,
                 const Context& context) {
  const auto lower = [](unsigned char c) { return std::tolower(c); };
  for (const AreaSummary& other : areas) {
    if (!std::ranges::equal(area, other.area, {}, lower, lower)) continue;
    context.Warn(fmt::format("area '{}' is new beside area '{}'", area, other.area));
  }
}

}  // namespace

StatusOr<PriorMap> LoadPrior(const AreaBuildOptions& options, const Context& context) {
  PriorMap prior;
  std::error_code error;
  const bool exists = std::filesystem::exists(options.store, error);
  const bool needed = options.prior != "none" && options.prior != "published";
  if (!exists && !needed) return prior;
  // The store is opened also without a prior: a file that is no store fails before the build.
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store,
                            OpenStore(options.store, MapStore::Access::kReadOnly, context));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<AreaSummary> areas, store.Areas());
  const bool known = std::any_of(areas.begin(), areas.end(), [&](const AreaSummary& area) {
    return area.area == options.area;
  });
  if (known) {
    SHIFTMAP_ASSIGN_OR_RETURN(prior.exclusions, store.Exclusions(options.area));
    SHIFTMAP_ASSIGN_OR_RETURN(prior.waiting, store.WaitingRuns(options.area));
  } else {
    WarnOfAlike(options.area, areas, context);
  }
  if (options.prior == "none") return prior;
  if (options.prior == "published") {
    SHIFTMAP_ASSIGN_OR_RETURN(prior.published, store.PublishedVersion(options.area));
    if (!prior.published) return prior;
    SHIFTMAP_ASSIGN_OR_RETURN(
        prior.version,
        FindPriorVersion(
            options.area,
            *prior.published,
            [&](const std::string& line) { context.Warn(line + ": it is no prior"); },
            &store));
    if (!prior.version && !options.starts_anew) {
      return FailedPrecondition(
          "area '{}': every stored version of the line rests on what was taken out; --prior none "
          "with the logs of all runs that count starts anew",
          options.area);
    }
    if (!prior.version) return prior;
  } else {
    prior.version = VersionNumber(std::stoll(options.prior));
  }
  SHIFTMAP_RETURN_IF_ERROR(TakeEditsIn(options, context, &store, &prior));
  SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot snapshot,
                            store.LoadVersion(options.area, *prior.version));
  prior.content = snapshot.content();
  SHIFTMAP_ASSIGN_OR_RETURN(prior.known_runs, store.LineRuns(options.area, *prior.version));
  SHIFTMAP_RETURN_IF_ERROR(FindFallenOut(options, &store, &prior));
  return prior;
}

Status LoadMemory(const AreaBuildOptions& options,
                  const std::vector<MapperInput>& inputs,
                  const Context& context,
                  PriorMap* prior) {
  if (!prior->version) return OkStatus();
  std::set<std::string> runs;
  Stamp begin = Stamp::max();
  for (const MapperInput& input : inputs) {
    if (!input.run.odometry.empty()) begin = std::min(begin, BeginOf(input.run));
    runs.insert(input.sha256);
    if (!input.run.info.uuid.empty()) runs.insert(input.run.info.uuid);
  }
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store,
                            OpenStore(options.store, MapStore::Access::kReadOnly, context));
  SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot map,
                            store.LoadAt(options.area, prior->version, begin));
  prior->content = map.content();
  SHIFTMAP_ASSIGN_OR_RETURN(prior->visibility,
                            store.MappedVisibility(options.area, *prior->version, runs));
  if (options.no_learned_rates) return OkStatus();
  SHIFTMAP_ASSIGN_OR_RETURN(prior->evidence, store.Evidence(options.area, *prior->version, runs));
  SHIFTMAP_ASSIGN_OR_RETURN(prior->older_runs,
                            LoadOlderRuns(options.area, *prior->version, runs, &store));
  return OkStatus();
}

}  // namespace shiftmap
