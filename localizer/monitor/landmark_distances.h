// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "localizer/hypothesis/hypothesis_bank.h"

namespace shiftmap {

/// Pairs of landmarks seen in one scan that both fail.
struct FailingPairs {
  int pairs = 0;
  int as_in_map = 0;  ///< As far apart as two of their modes.
};

/// Compares the distances between landmarks that no mode explains with those between their modes,
/// which takes no pose.
FailingPairs CompareDistances(const Scan& scan,
                              const std::vector<ObservationOutcome>& outcomes,
                              const MapSnapshot& snapshot);

}  // namespace shiftmap
