// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "localizer/localizer_state.h"
#include "mapstore/map/map_snapshot.h"
#include "mapstore/map/mode_filter.h"
#include "mapstore/run/run.h"
#include "proto/core/status.h"

namespace shiftmap {

/// How a shift went on a map.
struct ShiftScore {
  std::array<double, kLocalizerStates> seconds_in_state = {};  ///< By LocalizerState. [s]
  double nis_sum = 0.0;      ///< Of the observations that corrected the pose.
  std::int64_t dof = 0;      ///< Of nis_sum.
  std::int64_t ungated = 0;  ///< Observations of known landmarks at no place of theirs.
  int decisions = 0;         ///< Landmarks whose mode was decided, each once.
  int met = 0;               ///< Landmarks whose mode the mapper found, with the whole run,
  int right = 0;             ///< and those of them that were decided for it in the end.

  double seconds() const;

  /// NIS per degree of freedom; 1 if nothing corrected the pose.
  double nis_per_dof() const { return dof > 0 ? nis_sum / static_cast<double>(dof) : 1.0; }

  /// Share of the time in one of the states; 0 of a shift that took none.
  double ShareOf(LocalizerState state) const;

  /// Share of the time without a pose that is trusted: INITIALIZING and LOST.
  double lost_share() const;

  /// Share of the time LOST; all of it if nothing ever corrected a pose.
  double unlocalized_share() const { return dof > 0 ? ShareOf(LocalizerState::kLost) : 1.0; }

  /// Share of the observations of known landmarks that were at no place of theirs.
  double ungated_share() const;

  /// Share of the landmarks met that were not decided, or for another mode.
  double wrong_share() const;

  /// INITIALIZING, LOST and UNKNOWN_CHANGE: the map did not do.
  double doubt_share() const;
};

/// The same version with another content.
MapSnapshot WithContent(const MapSnapshot& map, MapContent content);

/// A map as it was known when a shift began: the modes' probabilities come from the rows that begin
/// before, the chains' stationary distributions where there is none. Two maps that are given the
/// same rows differ by what their versions say, and by nothing that only one of them has learned.
/// @param rows  Of any landmarks; those of the shift itself left out by the caller.
MapSnapshot KnownBefore(const MapSnapshot& map, const std::vector<EvidenceRow>& rows, Stamp begin);

/// The mode in which each landmark stood in a run, last.
using FoundModes = std::map<Signature, ModeNumber>;

/// What the mapper found, by the rows that it made of the run.
/// @param run  SHA-256 of its log. Of one that is not mapped nothing is known.
FoundModes FindModes(const std::vector<EvidenceRow>& rows, const std::string& run);

/// Localizes a shift that is over, from a start that is found.
/// @param map    As KnownBefore gives it.
/// @param found  What decisions are compared with.
/// @param on_step  Asked now and then; an error ends it.
/// Errors: as Localizer::Process.
StatusOr<ShiftScore> Replay(const Run& run,
                            const MapSnapshot& map,
                            const FoundModes& found,
                            const std::function<Status()>& on_step);

}  // namespace shiftmap
