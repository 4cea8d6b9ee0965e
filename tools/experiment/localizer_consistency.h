// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

namespace shiftmap {

/// Does a pose's covariance say what its error is? The normalized estimation error squared (NEES)
/// of the last pose of simulated drives through an uncertain map; 3 on average where it does.
struct ConsistencyScene {
  double sd_map_m = 0.1;     ///< Of each coordinate of a landmark. [m]
  double correlation = 0.5;  ///< Between any two landmarks' errors, in [0, 1).
  double duration_s = 60.0;
  int landmarks = 12;
};

struct ConsistencyResult {
  double nees = 0.0;        ///< Mean over the runs, of KnownMapFilter.
  double nees_exact = 0.0;  ///< Of an EKF of three states that takes the map as exact.
  double rmse_m = 0.0;      ///< Of the position.
  double rmse_exact_m = 0.0;
};

/// Draws map errors, pose, calibration, bias and noise from what the filter assumes.
ConsistencyResult MeasureConsistency(const ConsistencyScene& scene,
                                     std::uint64_t first_seed,
                                     int runs,
                                     int threads);

}  // namespace shiftmap
