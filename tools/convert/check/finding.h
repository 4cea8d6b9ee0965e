// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "mapstore/core/stamp.h"

namespace shiftmap {

/// How much a finding matters.
enum class Severity {
  kNote,     ///< Good to know.
  kWarning,  ///< A person should see it: the map may be wrong.
  kError,    ///< No map can be made of the log.
};

/// "note", "warning" or "error".
const char* SeverityName(Severity severity);

/// One thing that a check found in a run log.
struct Finding {
  Severity severity = Severity::kNote;
  std::string code;     ///< Fixed, e.g. "bearing_sign".
  std::string place;    ///< What it is about, and where it is first.
  std::string message;  ///< What is the matter.
  std::string advice;   ///< What to do.
};

using Findings = std::vector<Finding>;

/// "12.345 s into the run".
std::string TimeInRun(Stamp stamp, Stamp begin);

/// Names between quotes, at most ten, and how many more there are.
std::string SomeNames(const std::vector<std::string>& names);

}  // namespace shiftmap
