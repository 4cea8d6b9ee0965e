// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "proto/core/status.h"

namespace shiftmap {

/// One `key = value` of a configuration file.
struct ConfigEntry {
  /// The table: `build` for [build], `mapper.build` for [mapper.build]; empty at the top.
  std::string section;

  std::string key;  ///< As an option without dashes: `max_range_m` is `max-range-m`.
  std::vector<std::string> values;  ///< One, or the items of an array.
  int line = 0;                     ///< In the file, from 1.
};

/// Reads a TOML file of options: keys with strings, numbers, booleans or arrays of them, at the
/// top, in tables, or in tables of tables. Their meaning: mapstore/cli/README.md. Errors:
/// kNotFound; kInvalidArgument with `<path>:<line>`, if it is not TOML, or a value is anything
/// else.
StatusOr<std::vector<ConfigEntry>> ReadConfigFile(const std::string& path);

}  // namespace shiftmap
