// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "mapper/nightly/fleet_folder.h"
#include "mapper/nightly/judge.h"
#include "mapper/nightly/judged_version.h"
#include "mapstore/map_store.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Looks for runs of a version whose vehicle's clock was wrong, and makes them suspects:
///
///   - its log has a gap of an hour: the clock was set meanwhile, or two runs are in it;
///   - the vehicle was in another run of the area at that time; where both are of this build,
///     both are suspects, since nothing tells which it is;
///   - the run ended later than it was handed in: the clock was ahead. A run is handed in by the
///     time at which its report or its upload came (ReceivedRun), or at which its file was changed
///     last in the folder (ctime), all by the clocks of machines that are not the vehicle;
///   - the run began before the map existed that it was driven on, as its report of a live stream
///     says: the clock was behind. The map existed when most of the runs that it was made from had
///     ended and, where others' runs come within a day, when it was committed.
///
/// A run that came much later than others do after their end may have been late, or have a clock
/// that is behind: where nothing of the above decides, that is a doubt and no suspicion.
/// @param logs  Those that the version may have been built from.
/// Errors: those of the store.
Status CheckClocks(const std::string& area,
                   const JudgedVersion& version,
                   const std::vector<LogHead>& logs,
                   MapStore* store,
                   Judgement* judgement);

}  // namespace shiftmap
