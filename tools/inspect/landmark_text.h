// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "mapstore/cli/context.h"
#include "mapstore/cli/text_style.h"
#include "tools/inspect/landmark_history.h"

namespace shiftmap {

/// Whether a state of this probability is taken for the one that holds: it is more probable than
/// all others together, by more than three digits tell.
inline bool IsDecided(double probability) { return probability > 0.5005; }

/// What the map says of the landmark in one or two lines, and from what.
std::string VerdictText(const LandmarkHistory& history);

/// Its modes over the versions: positions, probabilities, visits, and what became of them.
std::string ModesText(const LandmarkHistory& history, const TextStyle& style);

/// Its move rate with the interval and the visits behind it, for people.
std::string MoveRateText(const LandmarkHistory& history);

/// A row per visit, newest last.
/// @param limit  The newest so many; 0: all.
std::string VisitsText(const LandmarkHistory& history, std::size_t limit, const TextStyle& style);

/// The probabilities at the times of LandmarkHistory::track.
std::string TrackText(const LandmarkHistory& history, const TextStyle& style);

/// All of a history as a document.
/// @param limit  As VisitsText.
Json HistoryJson(const LandmarkHistory& history, std::size_t limit);

/// Probabilities by mode number, `{"0": 0.1, "1": 0.9}`.
Json ProbabilitiesJson(const std::vector<ModeProbability>& modes);

}  // namespace shiftmap
