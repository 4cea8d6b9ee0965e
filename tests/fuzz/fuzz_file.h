// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

#include "tests/support/temp_dir.h"

namespace shiftmap::testing {

/// Writes bytes to a file of this process, the same one every time, and returns its path.
inline std::string FuzzFile(std::string_view bytes) {
  static const TempDir folder;
  std::string path = folder.File("input");
  WriteFile(path, std::string(bytes));
  return path;
}

}  // namespace shiftmap::testing
