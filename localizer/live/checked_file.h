// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

#include "proto/core/status.h"

namespace shiftmap::live {

/// Writes a message whole or not at all, with a line before it that has its checksum.
/// @param kind  One word that the line begins with. Errors: as WriteFileAtomically.
Status WriteCheckedFile(std::string_view kind, std::string_view message, const std::string& path);

/// Reads the message back. Errors: kNotFound; kDataLoss if a byte is wrong.
StatusOr<std::string> ReadCheckedFile(std::string_view kind, const std::string& path);

}  // namespace shiftmap::live
