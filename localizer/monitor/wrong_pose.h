// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <vector>

#include "localizer/initialization/global_start.h"
#include "localizer/monitor/health_monitor.h"
#include "localizer/monitor/recent_scans.h"

namespace shiftmap {

/// A pose after a scan, and what was seen up to it.
struct PresentPose {
  PoseWithCovariance pose;
  Stamp stamp;                ///< Of the scan.
  const RecentScans& recent;  ///< Up to the scan.
  const HealthMonitor& health;
};

/// Whether most landmarks do not stand by dead reckoning: at no place is half of their sightings.
/// @param min_adrift  Of such landmarks. One may be carried.
bool ContradictsOdometry(const std::vector<WindowScan>& window,
                         const MapSnapshot& snapshot,
                         int min_adrift);

/// What speaks against a pose.
struct PoseFault {
  Stamp since;  ///< Begin of the window in which the pose failed.

  /// Another pose at its end that explains what fails, as it may if the landmarks moved as one.
  /// Nothing: the pose is wrong.
  std::optional<PoseWithCovariance> rival = std::nullopt;

  bool odometry = false;  ///< Odometry is wrong, and the pose with it.
};

/// Finds out that the vehicle is elsewhere: that odometry is wrong, or that one other pose explains
/// what fails.
///
/// Landmarks stand while they are in view, wherever that is. So where most do not stand by dead
/// reckoning, odometry is wrong, and with it the pose that at least half of them contradict. A
/// single one in view, which may be carried, says so too: nothing else holds the pose.
///
/// Two causes are weighed for the landmarks that fail. If they moved, each did so by itself, and no
/// pose fits more than two of them but by chance. If the pose is wrong, one motion puts all of them
/// back on modes of theirs, and takes those that agree off theirs. So another pose has to explain
/// three landmarks more than agree with this one, be apart from it, and beat every third pose as
/// FindGlobalStart() asks. A rack that moved and pulled the pose along has the same effect: a wrong
/// pose does not show that odometry is wrong.
///
/// Several that moved as one, as a rack does, are also explained by one motion. So if landmarks
/// that agreed before have not turned, what is missed decides: one who is elsewhere misses what
/// should be here, and not what should be there. A rack that turned is missed where it stood before
/// it is seen where it stands. So against a pose that as many landmarks have agreed with in the
/// last half minute as speak for another, three have to be missed.
///
/// Windows of 3, 1.5 and 0.75 s are asked: the longer tell more, the shorter do without what was
/// seen before the pose went wrong, and without odometry that may be what is wrong.
/// @param field_of_view  The vehicle's.
/// @return Nothing if nothing speaks against the pose.
std::optional<PoseFault> FindWrongPose(const PresentPose& present,
                                       const MapSnapshot& snapshot,
                                       const FieldOfView& field_of_view,
                                       const GlobalStartOptions& options);

/// Finds another pose after a start that may rest on landmarks which moved as one, as a rack does.
/// The other pose explains more landmarks of the recent scans than the present pose does. The
/// landmarks that made the start do not count for the present pose as long as the scans reach back
/// to the start. Windows as above forget those landmarks, or see nothing else.
/// @param present  Its recent scans cover the way since the start, or the last part of it.
/// @param started  When the present pose was started.
std::optional<PoseWithCovariance> FindOtherStart(const PresentPose& present,
                                                 Stamp started,
                                                 const MapSnapshot& snapshot,
                                                 const GlobalStartOptions& options);

}  // namespace shiftmap
