// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/core/stamp.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Checks a stamp from outside: within 146 years of 1970, so that differences do not overflow.
/// Errors: kInvalidArgument.
Status ValidateStamp(Stamp stamp);

}  // namespace shiftmap
