// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <fstream>
#include <string>
#include <string_view>

#include "proto/core/status.h"

namespace shiftmap {

/// Size above which a text of rows (CSV, TUM, recorded data) is refused: some three million rows.
inline constexpr std::size_t kMaxTextBytes = std::size_t{256} << 20;

/// Opens a regular file for reading as binary. A pipe, a socket and a device are refused without
/// opening them: to open one may wait for ever, to read one may never end.
/// Errors: kNotFound; kInvalidArgument for what is no regular file, or cannot be read from its
/// begin; kUnavailable if it cannot be opened. Messages do not name the file.
StatusOr<std::ifstream> OpenInputFile(const std::string& path);

/// Reads a regular file as a whole.
/// @param kind  For messages, which start with `KIND 'PATH': `.
/// Errors: as OpenInputFile; kInvalidArgument above `max_bytes`; kUnavailable if reading fails.
StatusOr<std::string> ReadInputFile(std::string_view kind,
                                    const std::string& path,
                                    std::size_t max_bytes = kMaxTextBytes);

/// Takes the next line off `text`, without the line feed that ends it. False at the end.
bool TakeLine(std::string_view* text, std::string_view* line);

}  // namespace shiftmap
