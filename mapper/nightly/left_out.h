// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <set>
#include <string>
#include <vector>

#include "mapper/nightly/fleet_folder.h"
#include "mapper/nightly/night_options.h"
#include "mapstore/map_store.h"
#include "proto/core/status.h"

namespace shiftmap {

/// The runs, by LogHead::identity, that an earlier night left out of a build of these logs, if
/// nothing has changed since that could change that: the files, this program, its options and
/// memory, or what is published, excluded, held or edited. Errors: those of the store.
StatusOr<std::set<std::string>> ReadLeftOut(const NightOptions& options,
                                            const std::string& area,
                                            const std::vector<LogHead>& logs,
                                            MapStore* store);

/// Keeps in the audit log what a night left out of a build of these logs.
/// Errors: those of the store.
Status NoteLeftOut(const NightOptions& options,
                   const std::string& area,
                   const std::vector<LogHead>& logs,
                   const std::set<std::string>& left_out,
                   MapStore* store);

}  // namespace shiftmap
