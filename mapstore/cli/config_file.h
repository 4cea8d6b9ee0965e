// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "proto/core/status.h"

namespace shiftmap {

/// One `key = value` of a configuration file.
struct ConfigEntry {
  std::string section;  ///< The command it is for; empty at the top of the file.
  std::string key;      ///< As an option without dashes: `max_range_m` is `max-range-m`.
  std::vector<std::string> values;  ///< One, or the items of an array.
};

/// Reads a TOML file of options: keys with strings, numbers, booleans or arrays of them, at the top
/// for every command or in a table named after one.
/// Errors: kNotFound; kInvalidArgument with `<path>:<line>`, if it is not TOML, or a value is
/// anything else.
StatusOr<std::vector<ConfigEntry>> ReadConfigFile(const std::string& path);

}  // namespace shiftmap
