// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "mapstore/cli/text_style.h"
#include "mapstore/map/map_diff.h"
#include "mapstore/map/map_snapshot.h"
#include "tools/inspect/move_rate_estimate.h"
#include "tools/plot/change_plot.h"

namespace shiftmap {

/// What changed from one map to another, in the order of what matters: landmarks and modes that
/// are new or gone, other modes that hold, modes that moved beyond their covariance, rates that
/// changed by more than their interval. One line sums up each kind of small change.
/// A motion of the frame is one line, and renames are none: the edits say them.
/// @param rates  Of the second map. A rate without an interval here has changed by more than it.
/// @param all    Every change in full; else at most one screen.
std::string DiffText(const EarlierMap& from,
                     const MapSnapshot& to,
                     const MapDiff& diff,
                     const MoveRates& rates,
                     bool all,
                     const TextStyle& style);

}  // namespace shiftmap
