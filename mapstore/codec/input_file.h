// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fstream>
#include <string>

#include "proto/core/status.h"

namespace shiftmap {

/// Opens a file for reading as binary; a pipe with a name will do.
/// Errors: kNotFound; kInvalidArgument for a folder; kUnavailable if it cannot be opened. Messages
/// do not name the file.
StatusOr<std::ifstream> OpenInputFile(const std::string& path);

}  // namespace shiftmap
