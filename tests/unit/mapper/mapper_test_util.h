// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "mapper/frontend/mapping_run.h"
#include "mapper/mapper.h"
#include "mapper/state/build_state.h"
#include "mapstore/run/trajectory.h"
#include "tools/sim/open_world.h"

namespace shiftmap::testing {

/// A small floor that is quick to map: 12 landmarks with two places each on 14 m x 14 m.
OpenWorldOptions SmallWorld(std::uint64_t seed);

/// One run of a world whose landmarks stand still.
SimulatedWorld StaticWorld(std::uint64_t seed);

/// Two halls of eight landmarks each, 200 m apart with none in between, and runs that go to and fro
/// by odometry that loses some metres on the way.
/// @param moved  So many landmarks of the second hall stand a metre away in the last run.
SimulatedWorld TwoHalls(std::uint64_t seed,
                        int runs,
                        const OdometryCalibration& odometry = {.noise_v = 0.02,
                                                               .noise_omega = 0.005},
                        int moved = 0);

/// A run once around a square of 400 m, along which a landmark stands every 8 m, to where the first
/// few are seen again.
SimulatedWorld LongLoop(std::uint64_t seed);

/// A run of 300 s among 14 landmarks on 20 m, in the middle of which the vehicle stands for
/// `stand_s` more.
SimulatedWorld LongStand(std::uint64_t seed, double stand_s);

/// A floor of 30 m with 16 landmarks that stand still and six that move by 0.8 m, and back, every
/// 200 s. Each run takes 900 s.
SimulatedWorld Doors(std::uint64_t seed, int runs);

/// Where a world has every place of its landmarks, to `sd_m`, each by itself.
MapContent SurveyOf(const SimulatedWorld& world, double sd_m);

/// Modes of all groups.
std::size_t CountModes(const BuildState& build);

/// SimulateOpen() for options that are known to be right.
SimulatedWorld Simulate(const OpenWorldOptions& options);

/// The runs of a world as the mapper takes them, named run-0, run-1, ...
std::vector<MapperInput> Inputs(const SimulatedWorld& world);

/// A run arranged for mapping, with the signatures of the world.
MappingRun Arrange(const SimulatedWorld& world, const Run& run);

/// The run without what it logged in [begin, end): the vehicle stands where it was at the end, by
/// its log at once.
SimulatedRun CarriedMeanwhile(SimulatedRun run, Stamp begin, Stamp end);

/// The signatures of all groups of a world, ascending.
std::vector<Signature> SignaturesOf(const SimulatedWorld& world);

/// The true pose at every key frame of a run.
std::vector<Se2> TruePoses(const SimulatedRun& simulated, const MappingRun& run);

/// Root mean square distance of two trajectories after the best rigid alignment. [m]
double AlignedRmse(const std::vector<Se2>& estimate, const std::vector<Se2>& truth);

/// Per group of the world the modes that held in a run and were sighted at least `min_sightings`
/// times there.
std::vector<std::vector<ModeNumber>> VisitedModes(const SimulatedWorld& world, int min_sightings);

/// A mode of a map and the true place that it is.
struct MatchedMode {
  std::size_t group = 0;  ///< In the map.
  std::size_t mode = 0;   ///< In the group.
  ModeNumber truth;
  Eigen::Vector2d error = Eigen::Vector2d::Zero();  ///< After rigid alignment, map frame. [m]
};

/// Matches every mode of a map, whose frame is the start of the world's run `first_run`, with the
/// nearest place of its landmark; errors are left after the best rigid alignment of all.
std::vector<MatchedMode> MatchModes(const MapContent& content,
                                    const SimulatedWorld& world,
                                    std::size_t first_run = 0);

/// Where a map has its modes, and by how much it is wrong, as of MatchModes().
struct ModeErrors {
  std::vector<Eigen::Vector2d> positions;  ///< [m]
  Eigen::VectorXd errors;                  ///< Stacked (x, y). [m]

  /// By how much the map is too large. [-]
  double Scale() const;
};

ModeErrors ErrorsOf(const MapContent& content, const SimulatedWorld& world);

/// The errors of maps in standard deviations of their joint covariances, both relative to the
/// positions as a whole, which is what a map's covariance is about.
struct MapConsistency {
  double nees = 0.0;  ///< χ² of `dof` degrees of freedom if the covariance is right.
  int dof = 0;
  double squared_error = 0.0;  ///< [m²]
  int modes = 0;

  double PerLandmark() const { return 2.0 * nees / dof; }

  void Add(const MapConsistency& other);
};

/// @param errors      Of positions, stacked (x, y). [m]
/// @param covariance  Theirs. [m²]
/// @param unknown     Directions that no run observes, orthonormal columns.
MapConsistency ConsistencyOf(const Eigen::VectorXd& errors,
                             const Eigen::MatrixXd& covariance,
                             const Eigen::MatrixXd& unknown);

MapConsistency MeasureConsistency(const MapContent& content, const SimulatedWorld& world);

/// Expects the NEES within the 99.9 % interval of its χ², and that it would be outside of it with
/// variances that are 25 % smaller.
void ExpectRightVariances(const MapConsistency& maps);

}  // namespace shiftmap::testing
