// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "mapstore/cli/context.h"
#include "mapstore/map/map_edit.h"

namespace shiftmap {

/// An edit as a document: id, kind, author, reason, made_s, the version made with it first, and
/// what its kind says; `undone` is null unless it was taken back.
Json EditJson(const MapEdit& edit);

/// What an edit says, as part of a line: "position of 'L07' mode 2 at (1.000, 2.000) m, sd 0.020
/// m".
std::string EditText(const MapEdit& edit);

/// The same with who made it, when and why, and who took it back, as a line.
std::string EditLine(const MapEdit& edit);

}  // namespace shiftmap
