// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <set>
#include <vector>

#include "mapper/cli/area_build.h"
#include "mapper/map_edits.h"
#include "mapper/mapper.h"
#include "mapstore/cli/context.h"
#include "mapstore/map_store.h"
#include "mapstore/store_types.h"
#include "proto/core/status.h"

namespace shiftmap {

/// What a build starts from.
struct PriorMap {
  std::optional<VersionNumber> version;
  std::optional<VersionNumber> published;  ///< Newer than `version` if it rests on excluded runs.
  std::optional<MapContent> content;
  BuildEdits edits;                   ///< In force.
  std::set<Signature> stated_places;  ///< StatedPlaces(): no modes of these landmarks are merged.
  std::vector<LineRun> known_runs;    ///< Those that are in it already.
  std::vector<RunRecord> fallen_out;  ///< Of versions newer than `version`.
  std::vector<UnplacedRun> waiting;   ///< Of earlier builds.
  std::vector<Exclusion> exclusions;  ///< What an operator took out of the area's memory.

  // Of the line of versions, LoadMemory:
  std::vector<EvidenceRow> evidence;       ///< To learn the chains from.
  std::vector<ModeVisibility> visibility;  ///< Of its runs.
  std::vector<RunRecord> older_runs;       ///< The newest of it.
};

/// The version that AreaBuildOptions::prior names, with the edits in force; nothing if the area has
/// none. Unless it is a dry run, this may write the version that holds these edits
/// (MapStore::WithEditsInForce).
/// Errors: those of the store; kFailedPrecondition if every version rests on what was taken out.
StatusOr<PriorMap> LoadPrior(const AreaBuildOptions& options, const Context& context);

/// Loads what the ledger says of the landmarks and of where they are visible from, but not of the
/// runs of the build: it sees their visits itself, with all modes, and none may count twice. The
/// prior map gets the probabilities of when they begin. Errors: those of the store.
Status LoadMemory(const AreaBuildOptions& options,
                  const std::vector<MapperInput>& inputs,
                  const Context& context,
                  PriorMap* prior);

}  // namespace shiftmap
