// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>

#include "localizer/hypothesis/state_values.h"
#include "mapstore/geometry/se2.h"
#include "mapstore/map/evidence.h"
#include "mapstore/map/landmark_group.h"

namespace shiftmap {

/// One visit of a group in progress: what all leaves have in common about it.
struct Visit {
  int group = 0;  ///< Index into MapSnapshot::groups().
  Stamp begin;
  Stamp end;                      ///< The last scan in which the group was seen or in view.
  std::int64_t observations = 0;  ///< Scans in which it was seen.
  bool seen = false;              ///< In the present scan.

  /// Where the vehicle was by dead reckoning at the last observation that was a view of its own,
  /// not a repetition.
  std::optional<Se2> T_odom_viewpoint;

  StateValues log_prior;  ///< Per state, over all leaves, at `begin`.

  /// Log-probability of each state when the sequential test gave it up; nothing while it is alive.
  boost::container::small_vector<std::optional<double>, kInlineStates> given_up;

  std::optional<int> decided;  ///< State; the last decision, if it was revised.
  int contradictions = 0;      ///< Observations in a row that disagree with `decided`.

  /// First observation that its likeliest state of `log_prior` does not explain, with a pose that
  /// rests on odometry alone.
  std::optional<Stamp> doubted_since;

  /// Other landmarks have agreed with the pose since then. A landmark that alone contradicts the
  /// map may as well say that the pose is wrong: wheels slip where nothing is seen.
  bool confirmed = true;

  bool explained = false;  ///< The last observation, by some mode: it does not say `absent`.

  /// State that was likeliest before the visit.
  int Favourite() const;

  /// Counts the observations in a row that contradict the decision; one that agrees ends the row.
  /// True when the row is long: the landmark moved in view, or the decision was wrong.
  bool IsOverturnedBy(bool agrees);

  /// Decided, and all other states were given up: there is nothing left to test.
  bool Settled() const;
};

/// Log-probability per state over all leaves and the states given up; sums to 1.
/// @param log_alive  Log-probability of the states that are alive.
StateValues LogPosterior(const Visit& visit, const StateValues& log_alive);

/// What the visit says about the group, prior excluded: log posterior - log prior, shifted so that
/// the largest entry is 0, none below -50. A state that was given up counts with its value of then.
/// A visit that is not confirmed says nothing.
/// @param log_posterior  Of LogPosterior.
VisitEvidence EvidenceOf(const Visit& visit,
                         const StateValues& log_posterior,
                         const LandmarkGroup& group);

}  // namespace shiftmap
