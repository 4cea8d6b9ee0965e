// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <random>
#include <vector>

#include "mapper/selection/selector.h"
#include "mapstore/geometry/se2.h"
#include "tools/experiment/ijrr_selectors.h"

namespace shiftmap {

/// A realization of the SLAM problem of IJRR figure 7.
struct IjrrSlamProblem {
  std::vector<Se2> true_poses;  ///< T_map_vehicle per observation; starts at the origin.
  std::vector<int> truth;       ///< Index of the place, per observation.
  std::vector<Eigen::Vector2d> observations;  ///< In the vehicle frame. [m]
  std::vector<Eigen::Vector2d> prior;         ///< The modes in the map, off by prior_sd_m. [m]
  double noise_m2 = 0.0;
};

/// Draws a realization: the robot is to stand still and is moved by the process noise.
IjrrSlamProblem SimulateIjrrSlam(const IjrrSelectorsOptions& options,
                                 double noise_m2,
                                 std::mt19937_64& random);

struct IjrrSlamResult {
  std::vector<int> states;
  int alternations = 0;           ///< Over all steps.
  double squared_error_m2 = 0.0;  ///< Of the last robot position plus that of the last mode.
};

/// The incremental mapper over the observations, a step each. The modes are known; none is made.
IjrrSlamResult SolveIjrrSlam(const IjrrSelectorsOptions& options,
                             const SelectorOptions& selector_options,
                             const IjrrSlamProblem& problem);

}  // namespace shiftmap
