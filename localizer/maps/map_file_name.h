// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "localizer/maps/map_folder.h"
#include "proto/core/status.h"

namespace shiftmap {

/// The name of a map's file in a folder of maps: `<map id>@<map version>@<sha256>.db`. Of the map
/// id, bytes other than letters, digits, `.`, `_` and `-`, and a dot in front, are %XX.
/// Errors: kInvalidArgument if no file system takes a name as long as that.
StatusOr<std::string> MapFileName(const FolderMap& map);

/// Its inverse: map_id, map_version and sha256; nothing for another file's name.
std::optional<FolderMap> ParseMapFileName(std::string_view name);

}  // namespace shiftmap
