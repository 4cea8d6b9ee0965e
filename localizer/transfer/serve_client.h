// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "localizer/maps/map_folder.h"
#include "proto/core/status.h"

namespace shiftmap::transfer {

/// Has `serve` take a map of its folder, if no shift is under way.
/// Errors: kUnavailable while one is; kNotFound if `serve` is not there; as its reply.
Status EnableBetweenShifts(const std::string& socket, const FolderMap& map);

}  // namespace shiftmap::transfer
