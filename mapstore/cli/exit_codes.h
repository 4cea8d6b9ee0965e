// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "proto/core/status.h"

namespace shiftmap {

/// What a command tells the script that ran it. Append-only: scripts rely on the numbers.
enum class ExitCode : int {
  kDone = 0,
  kUsage = 2,         ///< The command line or the configuration file is wrong.
  kBadInput = 3,      ///< Do not retry: the input will stay wrong.
  kConflict = 4,      ///< The published version moved in between: plan again.
  kNothingToDo = 5,   ///< What was asked for is there already.
  kNotFound = 6,      ///< No such file, area, version.
  kNotLocalized = 7,  ///< The log fits no place of this map.
  kAttention = 8,     ///< Done, with something left that a person should see.
  kInternal = 70,     ///< A bug of ours.
  kTemporary = 75,    ///< Busy or full now: retry.
  kStopped = 130,     ///< SIGINT or SIGTERM stopped it; the message says what is written.
};

/// The exit code of a command that ended with `status`, by the table in proto/core/status.h.
ExitCode ExitCodeFor(const Status& status);

}  // namespace shiftmap
