// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <ostream>

#include "mapstore/cli/exit_codes.h"
#include "mapstore/cli/text_style.h"

namespace shiftmap {

/// Runs `once` again and again: on a terminal each result takes the place of the one before, cut to
/// its height, with the time above it; elsewhere they follow each other. SIGINT and SIGTERM end it
/// with kDone; an error that may pass (kTemporary) is waited out, any other ends it.
/// @param period_s  Between the starts of two runs. [s]
/// @param style     Of `out`; without rows it is no terminal.
/// @param once      Writes a result to the stream that it is given.
ExitCode Watch(double period_s,
               const TextStyle& style,
               std::ostream* out,
               const std::function<ExitCode(std::ostream*)>& once);

}  // namespace shiftmap
