// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "mapper/nightly/fleet_folder.h"
#include "mapstore/map_store.h"
#include "proto/core/status.h"

namespace shiftmap {

/// The areas that a log which names none may be of.
struct LogAreas {
  int asked = 0;  ///< Published maps that it was localized on.
  std::vector<std::string> fit;
  bool known = false;  ///< From the audit log; nothing was localized.
};

/// Localizes a log on the published map of each area that has at least three of its landmarks. It
/// fits where a start was found and the pose is trusted for half of the time.
/// @param on_step  Asked now and then; an error ends it.
/// Errors: those of the store, of ReadRunLog and of `on_step`.
StatusOr<LogAreas> LocateLog(const LogHead& log,
                             MapStore* store,
                             const std::function<Status()>& on_step);

/// What was found of a log before: an area for ever, that none or several fit as long as the store
/// has as many published maps.
/// @param audit  Of the whole store.
std::optional<LogAreas> KnownAreas(const std::string& run,
                                   int published_areas,
                                   const std::vector<AuditEntry>& audit);

/// What KnownAreas reads, for MapStore::AddNote.
std::string LocatedSubject(const std::string& run, const LogAreas& areas);

}  // namespace shiftmap
