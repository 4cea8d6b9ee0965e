// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "localizer/localizer_options.h"
#include "localizer/models/field_of_view.h"
#include "mapstore/cli/command.h"

namespace shiftmap {

/// What a user says of the localizer, of one log or of a live vehicle.
struct LocalizerArguments {
  std::string initial_pose = "auto";
  double alpha = HypothesisOptions().alpha;
  int max_leaves = HypothesisOptions().max_leaves;
  std::string field_of_view = FieldOfViewNames().front();
  double max_delay_s = 0.0;
  LimitOptions limits = {};

  /// What is wrong with them; empty if nothing is.
  std::string Check() const;

  LocalizerOptions Options() const;
};

/// Adds `--alpha`, `--max-leaves` and `--field-of-view`; `arguments` must outlive the run.
void AddHypothesisOptions(LocalizerArguments* arguments, Command* command);

}  // namespace shiftmap
