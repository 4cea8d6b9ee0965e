// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <vector>

#include "mapper/alignment/explanation.h"
#include "mapper/state/joined_fit.h"
#include "mapper/state/run_name.h"

namespace shiftmap {

/// Runs that wait: they agree with each other, may lie at several places in the map, and nothing
/// decides between these; or a run that does not fit at the place that was decided for.
struct WaitingRuns {
  std::vector<RunName> runs;
  Explanations explanations;        ///< Of one that does not fit: none.
  std::optional<JoinedFit> misfit;  ///< Of one that does not fit.
};

}  // namespace shiftmap
