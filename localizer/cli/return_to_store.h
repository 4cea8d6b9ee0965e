// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "localizer/transfer/cli/transfer_commands.h"
#include "mapstore/cli/context.h"
#include "mapstore/map/evidence.h"
#include "mapstore/store_types.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Hands shift reports to a map store on this host.
Status ReturnToStore(const ReturnArguments& options, Context& context);

/// What became of a report's rows: the keys `evidence_rows` and `set_aside`.
Json ReturnedJson(const ReturnResult& result);

/// The same for people, a line for the rows and one for each reason that keeps some aside.
std::string ReturnedText(const ReturnResult& result);

/// Names a report of a clock that was not set: what a person hands in counts all the same, as in a
/// build, while servers and nights leave it out.
/// @param what  As for CheckClockWasSet.
void WarnOfUnsetClock(const std::string& what, const ShiftReport& report, const Context& context);

}  // namespace shiftmap
