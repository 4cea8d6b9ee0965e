// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "mapstore/geometry/covariance.h"
#include "mapstore/map/map_snapshot.h"
#include "mapstore/run/run.h"

namespace shiftmap {

/// What happens to a simulated vehicle or its surroundings in the course of a shift.
enum class ShiftCause {
  kNothing,
  kModeChange,       ///< Landmarks stand at another known mode.
  kMoved,            ///< Landmarks stand where no mode is.
  kRemoved,          ///< Landmarks are gone.
  kKidnapped,        ///< The vehicle is carried 3 m or more.
  kNudged,           ///< The vehicle is carried 0.5 m.
  kWheelSlip,        ///< Odometry says that it drives while it stands.
  kOdometryDoubled,  ///< Odometry says twice the speed.
  kOdometryFrozen,   ///< Odometry repeats its last sample.
  kDuplicate,        ///< A signature is at two places.
  kRackMoved,        ///< Neighbours stand where no mode is, all displaced by one motion.
};

inline constexpr std::size_t kShiftCauses = 11;

/// In tables, e.g. "mode change".
const char* ToString(ShiftCause cause);

/// The pose, and not the map, is what fails.
bool IsPoseFailure(ShiftCause cause);

/// A log with a known cause.
struct CausedShift {
  MapContent content;
  PoseWithCovariance start;
  std::vector<RunEvent> events;    ///< By stamp.
  Stamp cause;                     ///< When it set in; before it nothing was amiss.
  Stamp over;                      ///< When a failure of odometry ended, otherwise `cause`.
  std::vector<Se2> T_map_vehicle;  ///< The truth, by scan.
  int affected = 0;                ///< Landmarks that stand elsewhere or are gone.
};

/// Seconds that the vehicle drives on after its cause set in.
inline constexpr double kAfterCauseS = 60.0;

/// Draws a shift: 8 to 60 landmarks 1.5 to 3.5 m apart, a field of view of 6 to 12 m and 0.6 to 1.6
/// rad to either side, ranges to 2 to 12 cm, bearings to 0.5 to 2 degrees, up to 2 % of signatures
/// misread; the vehicle drives through the landmarks from one random point to the next. A change
/// affects up to a third of the landmarks seen after it, each of them seen for five seconds or
/// more. A rack is 3 to 6 neighbours, displaced by 0.5 to 3 m and, half of them, turned by up to
/// 0.5 rad. Determinism: the same seed gives the same shift.
CausedShift DrawShift(ShiftCause cause, std::uint64_t seed);

}  // namespace shiftmap
