// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <deque>

namespace shiftmap {

/// Tells a lost vehicle from an old map.
///
/// A landmark at an unknown place fails to gate alone; when the pose is wrong, everything does.
/// So the pose counts as lost when most of the last observations of known signatures gate with
/// nothing, and they are of at least three groups. It counts as found again when half of them gate.
class HealthMonitor {
 public:
  /// @param gated  With a mode that the heaviest leaf holds possible.
  void Add(int group, bool gated);

  bool lost() const { return lost_; }

  /// Share of the window that gates; 1 if the window is empty.
  double gated_share() const;

  void Reset();

 private:
  struct Outcome {
    int group;
    bool gated;
  };

  std::deque<Outcome> window_;
  bool lost_ = false;
};

}  // namespace shiftmap
