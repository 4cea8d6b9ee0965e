// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <functional>
#include <string>

#include "localizer/live/messages.h"
#include "mapstore/map/map_snapshot.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Records a shift of a service (shift_recording.h) from its journal: the same inputs on the same
/// map give the same bits as they did while the vehicle drove, so that the service's step has
/// nothing to do with it. Makes no file of a shift without items.
/// @param map_of  Loads the map that the shift was begun on.
/// @param stop    Looked at after each item.
/// Errors: as `map_of`, ReadJournal and ShiftRecorder; kFailedPrecondition for another map;
/// kAborted if it was stopped.
Status RecordJournal(const std::string& journal,
                     const std::function<StatusOr<MapSnapshot>(const live::ShiftHeader&)>& map_of,
                     const std::string& software,
                     const std::string& path,
                     const std::atomic<bool>& stop);

}  // namespace shiftmap
