// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapper/build_progress.h"
#include "mapper/mapper_options.h"
#include "mapper/state/build_state.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Refines modes, noise and run variances of all runs jointly, and relocates or takes out runs that
/// do not fit where they are. Returns the outer iterations. Leaves no run where the last ones wait.
/// @param build  Of placed runs.
/// Errors: kInvalidArgument if no run can be used; kCancelled.
StatusOr<int> RefineTogether(const MapperOptions& options, BuildWatch* watch, BuildState* build);

}  // namespace shiftmap
