// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "mapstore/cli/context.h"
#include "mapstore/run/run.h"

namespace shiftmap {

/// Reports what was written to `output`, with what is said of this kind of log alone.
/// Precondition: the run has odometry.
void ReportRun(const std::string& output, const Run& run, const Json& more, Context& context);

}  // namespace shiftmap
