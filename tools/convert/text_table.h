// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "proto/core/status.h"

namespace shiftmap {

/// The fields of one row; valid during the call only.
using TextRow = std::vector<std::string_view>;

/// Rows may have any number of fields, but one at least.
inline constexpr std::size_t kAnyColumns = 0;

/// Reads a text file of rows whose fields are separated by blanks or tabs, and calls `take` with
/// each. Empty rows and rows that begin with '#' are skipped.
/// @param columns  Fields that every row must have, or kAnyColumns.
/// @param separators  Characters that separate fields besides; several in a row are one.
/// Errors: kNotFound; kUnavailable if it cannot be read; kInvalidArgument for a row with another
/// number of fields. Errors of `take` get `<path>:<line>: ` before them and end the reading.
Status ForEachRow(const std::string& path,
                  std::size_t columns,
                  const std::function<Status(const TextRow&)>& take,
                  std::string_view separators = "");

std::string FileIn(const std::string& folder, const std::string& name);

/// @param what  For the error: "utias data set".
/// Errors: kNotFound.
Status CheckFolder(const char* what, const std::string& folder);

}  // namespace shiftmap
