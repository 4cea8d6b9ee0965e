// SPDX-License-Identifier: Apache-2.0
//
// T-IV figures 6 and 8: drives through the modified mine on a map of the original one.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tools/experiment/tiv_world.h"

namespace shiftmap {

/// How a method's pose is after a scan.
struct TivError {
  double distance_m = 0.0;
  double nees = 0.0;  ///< Of the pose, 3 degrees of freedom.
};

/// What became of a signed corner of the prior map in a drive that saw it where it is now.
struct TivCorner {
  std::string signature;
  int sightings = 0;
  double p_prior = 0.0;     ///< Of the mode that the prior map has, at the end.
  double distance_m = 0.0;  ///< Of the likeliest mode from where the corner is; NaN if `absent`.
};

/// One drive.
struct TivMineRun {
  std::vector<TivError> multi;      ///< By step: the likeliest leaf of TreeSlam.
  std::vector<TivError> fixed;      ///< Static SLAM.
  std::vector<TivError> reckoning;  ///< Dead reckoning.
  std::vector<int> leaves;          ///< By step.
  std::vector<bool> corner_seen;    ///< By step.
  std::vector<TivCorner> corners;   ///< Of the prior map, seen at least as often as makes a mode.
  std::vector<Se2> truth;
  std::vector<Se2> multi_poses;
  std::vector<Se2> fixed_poses;
  MapContent posterior;
};

/// Errors: those of the simulator.
StatusOr<TivMineRun> RunTivMine(const TivWorld& world, std::uint64_t seed);

/// Over drives, at one step.
struct TivMineStep {
  double rmse_m = 0.0;
  double nees = 0.0;
};
std::vector<TivMineStep> MeanOverRuns(const std::vector<TivMineRun>& runs,
                                      const std::vector<TivError> TivMineRun::*method);

}  // namespace shiftmap
