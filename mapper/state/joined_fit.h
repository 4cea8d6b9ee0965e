// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "mapper/index.h"

namespace shiftmap {

/// How much worse a run fits with its landmarks where a joint map has them than by itself
/// (mapper/METHOD.md, 6).
struct JoinedFit {
  std::vector<GroupIndex> groups;  ///< That the run shares with others or the prior map, ascending.

  /// Twice the log-likelihood ratio: χ² of `dof` degrees of freedom if these stand there.
  double chi2 = 0.0;
  int dof = 0;
  double limit = 0.0;  ///< Of chi2.

  bool is_good() const { return chi2 <= limit; }
};

}  // namespace shiftmap
