// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <set>
#include <string>

#include "mapstore/cli/context.h"
#include "mapstore/core/ids.h"
#include "mapstore/core/stamp.h"
#include "mapstore/map_store.h"
#include "proto/core/status.h"

namespace shiftmap {

/// What was decided of an area since its published version became that.
struct SincePublished {
  Stamp published = Stamp::min();
  std::map<VersionNumber, std::string> refused;  ///< Reasons.
  std::set<std::string> included;                ///< Subjects of "include", of the whole past.
};

/// Errors: those of the store.
StatusOr<SincePublished> ReadSincePublished(const std::string& area, MapStore* store);

/// The same of a store that need not be there, or need not have the area: nothing then.
StatusOr<SincePublished> ReadSincePublished(const std::string& area,
                                            const std::string& store,
                                            const Context& context);

/// The command that publishes a version that is not, as one was refused or rolled back.
/// Errors: those of the store.
StatusOr<std::string> PublishCommand(const std::string& area,
                                     VersionNumber version,
                                     MapStore* store);

/// The version that a "publish", "rollback" or "refuse" is about.
VersionNumber VersionOf(const AuditEntry& entry);

}  // namespace shiftmap
