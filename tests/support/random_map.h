// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <random>
#include <string>
#include <vector>

#include "mapstore/map/evidence.h"
#include "mapstore/map/map_snapshot.h"

namespace shiftmap::testing {

/// The seed of random tests: SHIFTMAP_TEST_SEED from the environment, or else `fallback`; printed,
/// so that a failure can be repeated.
std::uint64_t TestSeed(std::uint64_t fallback);

struct RandomMapOptions {
  int groups = 20;
  int max_modes = 4;  ///< Each group has 1 to max_modes.
  int anonymous_landmarks = 3;
  int vehicles = 0;
  int rhythms = 0;  ///< The first so many groups have one, of the day and of the week in turn.
  double cross_block_share = 0.05;  ///< Of the pairs of neighbours in mode order.
  std::int64_t stamp_ns = 1'700'000'000'123'456'789;
};

/// A random symmetric positive definite matrix, eigenvalues about `scale`.
Eigen::Matrix2d RandomCovariance(std::mt19937_64& random, double scale);

/// Positions about the origin, normal with this standard deviation per axis. [m]
std::vector<Eigen::Vector2d> RandomPositions(std::mt19937_64& random, int count, double sd_m);

/// Random probabilities of `states` states, all positive.
Eigen::VectorXd RandomDistribution(std::mt19937_64& random, int states);

/// A group with modes 1..modes.
LandmarkGroup RandomGroup(std::mt19937_64& random, const std::string& signature, int modes);

/// Random rates for every hour of a day or a week.
ChainRhythm RandomRhythm(std::mt19937_64& random, int states, Duration period);

/// A valid calibration, every number random.
VehicleCalibration RandomVehicle(std::mt19937_64& random, const std::string& name);

/// Valid content, every number random.
MapContent RandomContent(std::mt19937_64& random, const RandomMapOptions& options = {});

/// A visit of `group` with random log-likelihoods for `absent` and all its modes.
VisitEvidence RandomEvidence(std::mt19937_64& random,
                             const LandmarkGroup& group,
                             Stamp begin,
                             Stamp end);

}  // namespace shiftmap::testing
