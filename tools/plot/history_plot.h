// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "mapstore/store_types.h"
#include "tools/inspect/landmark_history.h"

namespace shiftmap {

/// The ends of equal steps from a time to another one, both with them and exact; the first time
/// alone if the other one is not after it.
std::vector<Stamp> EvenTimes(Stamp from, Stamp to, std::int64_t steps);

/// The times at which a picture of a history needs its probabilities: HistoryOptions::choose_track.
/// @param version  The stamp of the map version.
/// @param end      Of the picture, if that is after the last visit.
std::vector<Stamp> HistoryTimes(const std::vector<VisitSpan>& visits, Stamp version, Stamp end);

/// The history of a landmark as an SVG picture: the probabilities of its modes over time, stacked;
/// each visit as a tick in the row of the mode that its evidence favours; map versions as vertical
/// lines, at the end of the newest run in them.
/// @param history   Has the track of HistoryTimes(), by stamp.
/// @param versions  Of the area.
std::string PlotHistory(const LandmarkHistory& history,
                        const std::vector<VersionSummary>& versions);

}  // namespace shiftmap
