// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "localizer/transfer/cli/transfer_commands.h"
#include "mapstore/cli/context.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Hands shift reports to a map store on this host.
Status ReturnToStore(const ReturnArguments& options, Context& context);

}  // namespace shiftmap
