// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>

#include "localizer/live/messages.h"
#include "mapstore/map/map_snapshot.h"
#include "proto/core/status.h"

namespace shiftmap::live {

/// Writes the pose, whole or not at all, with a checksum. Errors: as WriteFileAtomically.
Status WriteSavedPose(const SavedPose& saved, const std::string& path);

/// Errors: kNotFound; kDataLoss if a byte is wrong. Messages start with `saved pose 'PATH': `.
StatusOr<SavedPose> ReadSavedPose(const std::string& path);

/// The pose to start at, wider by what parking may do, or why there is none: kFailedPrecondition
/// if the map is another one, the pose is too old or from the future, or the vehicle has moved.
/// @param now         Stamp of the first item of the shift.
/// @param odometer_m  What the vehicle's odometer shows, if known. [m]
/// @param max_age_s   Older ones are not used. [s]
StatusOr<PoseWithCovariance> UsableStart(const SavedPose& saved,
                                         const MapSnapshot& map,
                                         Stamp now,
                                         std::optional<double> odometer_m,
                                         double max_age_s);

}  // namespace shiftmap::live
