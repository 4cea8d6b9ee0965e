// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

#include "mapper/alignment/explanation.h"
#include "mapper/index.h"
#include "mapper/state/run_name.h"

namespace shiftmap {

/// Runs whose place in the map is decided, but not which of their landmarks stayed. Each landmark
/// in doubt keeps the mode that it may have left, and has one beside it.
struct KeptAlternatives {
  struct Doubt {
    GroupIndex group;
    Eigen::Vector2d place = Eigen::Vector2d::Zero();  ///< Of the mode that it may have left. [m]
    double stayed = 0.0;                              ///< Probability that it did not leave it.
  };

  std::vector<RunName> runs;
  std::vector<StayedSet> alternatives;
  std::vector<GroupIndex> groups;  ///< In common, ascending.
  std::vector<Doubt> doubts;
};

}  // namespace shiftmap
