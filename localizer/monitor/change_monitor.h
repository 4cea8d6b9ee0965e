// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "localizer/monitor/health_monitor.h"
#include "localizer/monitor/sighting_collector.h"

namespace shiftmap {

/// Says when a landmark stands elsewhere, or is gone, and the pose is not to blame.
///
/// A wrong pose moves every landmark. So a change counts when, from its first sign on, other
/// landmarks were seen where the map has them: PoseSupport::Confirms(), and most of those seen
/// lately still are: PoseSupport::Agrees().
class ChangeMonitor {
 public:
  /// @param min_sightings  At one unknown place, with none at a mode in between.
  ChangeMonitor(std::size_t groups, int min_sightings)
      : failures_(groups), min_sightings_(min_sightings) {}

  /// A mode explains what was seen of a group.
  void Explained(int group);

  /// No mode does; it was seen at `place`.
  /// @return The support of the pose if the landmark was thereby found to stand there.
  std::optional<PoseSupport> Sighted(int group,
                                     const SightingCollector::PlaceState& place,
                                     const HealthMonitor& health);

  /// `absent` was decided for a group, or something else after it.
  void Decided(int group, bool absent, Stamp stamp);

  /// A group was missed as no landmark that stands at a mode is: MissedPasses.
  void Missed(int group, Stamp stamp) { Decided(group, true, stamp); }

  /// A group found to be gone, once the pose is confirmed. Each is returned once.
  struct Gone {
    int group = 0;
    PoseSupport support;
  };
  std::optional<Gone> TakeGone(const HealthMonitor& health, Stamp now);

  /// The pose was wrong: what was concluded by it does not hold.
  void Reset();

 private:
  struct Doubt {
    int group;
    Stamp stamp;
  };

  // The support of the pose by others than `group`, if it has been enough since `first`.
  std::optional<PoseSupport> Support(int group,
                                     Stamp first,
                                     Stamp now,
                                     const HealthMonitor& health) const;

  // Observations in a row that no mode explains.
  struct Failures {
    int count = 0;
    Stamp first;
  };

  std::vector<Failures> failures_;  // By group.
  std::vector<Doubt> gone_;         // Decided absent, not confirmed.
  int min_sightings_;
};

}  // namespace shiftmap
