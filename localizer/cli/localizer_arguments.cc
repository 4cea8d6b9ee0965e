// SPDX-License-Identifier: Apache-2.0
#include "localizer/cli/localizer_arguments.h"

#include <fmt/format.h>

#include "localizer/cli/initial_pose.h"

namespace shiftmap {

std::string LocalizerArguments::Check() const {
  if (initial_pose == "auto" || ParseInitialPose(initial_pose)) return "";
  return fmt::format("--initial-pose '{}', expected X,Y,YAW or auto", initial_pose);
}

LocalizerOptions LocalizerArguments::Options() const {
  LocalizerOptions options;
  options.hypotheses.alpha = alpha;
  options.hypotheses.max_leaves = max_leaves;
  options.hypotheses.field_of_view.model = FieldOfViewNamed(field_of_view);
  options.initial_pose = ParseInitialPose(initial_pose);
  options.max_delay_s = max_delay_s;
  options.limits = limits;
  return options;
}

void AddHypothesisOptions(LocalizerArguments* arguments, Command* command) {
  command->Option("--alpha", &arguments->alpha, "Accepted probability of a wrong decision")
      .InRange(1e-12, 0.49)
      .Option("--max-leaves", &arguments->max_leaves, "Hypotheses kept at most")
      .InRange(1, 1024)
      .Option("--field-of-view",
              &arguments->field_of_view,
              "Where a landmark that is not seen counts as missed: in the sensor's sector, or in "
              "what of it the last lidar scan covers")
      .OneOf(FieldOfViewNames());
}

}  // namespace shiftmap
