// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "localizer/hypothesis/hypothesis_view.h"
#include "mapstore/cli/context.h"

namespace shiftmap {

/// What a vehicle believes and why, as `run --json` and `ctl hypotheses --json` say it;
/// localizer/live/README.md.
Json HypothesisJson(const HypothesisView& view);

/// The same for people: a line per node, indented by its level, and a line per visit.
std::string HypothesisText(const HypothesisView& view);

}  // namespace shiftmap
