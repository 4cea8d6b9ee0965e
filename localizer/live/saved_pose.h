// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>

#include "localizer/live/messages.h"
#include "mapstore/map/map_snapshot.h"
#include "proto/core/status.h"

namespace shiftmap::live {

struct SavedPoseOptions {
  double max_age_s = 900.0;     ///< Older ones are not used, >= 0. [s]
  double max_odometer_m = 0.5;  ///< The vehicle was moved if its odometer differs by more. [m]
  double sd_position_m = 0.1;   ///< What a parked vehicle may be off by. [m]
  double sd_yaw_rad = 0.05;     ///< [rad]
};

/// Writes the pose, whole or not at all, with a checksum. Errors: as WriteFileAtomically.
Status WriteSavedPose(const SavedPose& saved, const std::string& path);

/// Errors: kNotFound; kDataLoss if a byte is wrong. Messages start with `saved pose 'PATH': `.
StatusOr<SavedPose> ReadSavedPose(const std::string& path);

/// The pose to start at, wider by what parking may do, or why there is none: kFailedPrecondition
/// if the map is another one, the pose is too old or from the future, or the vehicle has moved.
/// @param now         Stamp of the first item of the shift.
/// @param odometer_m  What the vehicle's odometer shows, if known. [m]
StatusOr<PoseWithCovariance> UsableStart(const SavedPose& saved,
                                         const MapSnapshot& map,
                                         Stamp now,
                                         std::optional<double> odometer_m,
                                         const SavedPoseOptions& options);

}  // namespace shiftmap::live
