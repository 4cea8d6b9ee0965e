// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <random>
#include <string>
#include <vector>

#include "mapstore/geometry/se2.h"
#include "mapstore/map/map_snapshot.h"
#include "mapstore/run/run.h"

namespace shiftmap {

/// A map to test on: `groups` landmarks with two modes each in a square of `size_m`, probabilities
/// (0.02, 0.9, 0.08): the first mode is the favourite.
MapContent MakeTwoModeMap(int groups, double size_m, std::uint64_t seed);

/// Gives all modes of a map a joint covariance.
void SetCovariance(const JointCovariance& covariance, MapContent* content);

MapSnapshot Snapshot(MapContent content);

struct SimulationOptions {
  std::uint64_t seed = 1;
  double duration_s = 60.0;
  double v_mps = 0.5;
  double omega_radps = 0.25;
  Se2 T_map_start;
  double clutter_share = 0.0;  ///< Of detections that get a wrong signature.
};

struct SimulatedRun {
  Run run;
  std::vector<Se2> T_map_vehicle;  ///< The truth, by scan.
};

/// Drives a circle through a world in which landmark i stands at `truth[i]`, by the calibration's
/// own motion and observation models (bias, scale and noise included).
SimulatedRun Simulate(const MapContent& content,
                      const std::vector<Eigen::Vector2d>& truth,
                      const SimulationOptions& options);

/// The positions of one state per group.
std::vector<Eigen::Vector2d> PositionsOf(const MapContent& content, const std::vector<int>& states);

}  // namespace shiftmap
