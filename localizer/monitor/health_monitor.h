// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/circular_buffer.hpp>
#include <cstddef>
#include <optional>

#include "mapstore/core/stamp.h"

namespace shiftmap {

/// How many landmarks agree with the pose and how many do not, by the last observation of each.
struct PoseSupport {
  int agreeing = 0;
  int failing = 0;
  Stamp since;           ///< Of the oldest observation that counts.
  double nis_sum = 0.0;  ///< Of all observations that gated with a mode.
  int updates = 0;       ///< Their number.

  /// Enough to believe that a landmark that fails stands elsewhere: most others agree (up to a
  /// third of those in view may have moved at once), and not barely, as they do with a pose that is
  /// off by little.
  bool Confirms() const;
};

/// Tells a lost vehicle from an old map.
///
/// A landmark at an unknown place fails alone; when the pose is wrong, everything does. So the pose
/// counts as lost when nearly all of the landmarks seen last agree with none of their modes and
/// with no place that they were found to have moved to. It counts as found again when half of them
/// agree.
class HealthMonitor {
 public:
  /// @param explained  By a mode of the group, or by a place that it is known to have moved to.
  /// @param nis        Of the mode, 2 dof; nothing where none explains.
  void Add(Stamp stamp, int group, bool explained, std::optional<double> nis);

  /// Takes in how many pairs of landmarks that fail were seen in one scan, and how many of them
  /// are as far apart as two of their modes. A wrong pose leaves distances as they are; landmarks
  /// that moved do not keep theirs.
  void AddPairs(Stamp stamp, int as_in_map, int pairs);

  bool lost() const { return lost_; }

  /// Of the last observations, those younger than `since` and not of `except` (-1: of all).
  PoseSupport Support(Stamp since, int except) const;

  /// Of all that it goes by.
  PoseSupport Support() const { return Support(Stamp::min(), -1); }

  /// Begin of the failures that made the pose lost: after the last observation that was explained
  /// before them. What was concluded since is not to be trusted.
  Stamp failing_since() const { return failing_since_; }

  void Reset();

 private:
  struct Outcome {
    Stamp stamp;
    int group;
    bool explained;
    std::optional<double> nis;
  };

  struct Pairs {
    Stamp stamp;
    int as_in_map;
    int pairs;
  };

  void JudgeLost();
  bool LandmarksMoved(Stamp since) const;

  // Observations gone by for the support of a change, and as many scans.
  static constexpr std::size_t kWindow = 48;

  boost::circular_buffer<Outcome> window_{kWindow};  // The last ones.
  boost::circular_buffer<Pairs> pairs_{kWindow};
  bool lost_ = false;
  Stamp failing_since_;
};

}  // namespace shiftmap
