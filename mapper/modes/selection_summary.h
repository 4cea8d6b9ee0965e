// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapper/mapper_options.h"

namespace shiftmap {

struct BuildState;

/// How good a selection is: the objective of IJRR (19) summed over all groups, and how sure the
/// chains are of it.
struct SelectionSummary {
  int visits = 0;

  /// Visits whose assigned mode has a posterior below kSureProbability given all visits of its
  /// group (forward-backward).
  int uncertain_visits = 0;

  double log_joint = 0.0;       ///< Of the assignment, constants left out.
  double best_log_joint = 0.0;  ///< The largest that any assignment to the same modes has.
};

inline constexpr double kSureProbability = 0.99;

/// Judges the present assignment of a build.
SelectionSummary SummarizeSelection(const ModeOptions& options, const BuildState& build);

}  // namespace shiftmap
