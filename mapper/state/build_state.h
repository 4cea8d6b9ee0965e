// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <compare>
#include <functional>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "mapper/covariance/mode_covariance.h"
#include "mapper/frontend/frame_motions.h"
#include "mapper/frontend/mapping_run.h"
#include "mapper/graph/graph.h"
#include "mapper/graph/sensor_distortion.h"
#include "mapper/mapper_options.h"
#include "mapper/state/undecided_runs.h"
#include "mapstore/core/ids.h"
#include "mapstore/map/calibration.h"
#include "mapstore/map/landmark_group.h"
#include "mapstore/map/map_snapshot.h"

namespace shiftmap {

/// A mode while the map is built.
struct BuildMode {
  Eigen::Vector2d p_map_landmark = Eigen::Vector2d::Zero();  ///< [m]
  ModeNumber number;  ///< That of the prior map; 0 for a mode that is not in it.

  /// Where it was told apart from the prior map's modes jointly with the other landmarks
  /// (FindDisplaced), which can tell more than a look at this landmark alone. [m]
  std::optional<Eigen::Vector2d> displaced_to = {};
};

/// The modes of a group.
using GroupModes = IndexedVector<GroupModeIndex, BuildMode>;

/// One of them, or none.
using OptionalMode = std::optional<GroupModeIndex>;
inline constexpr OptionalMode kUnassigned = std::nullopt;

/// Its state in the chain of the group, where 0 is `absent`.
inline int StateOf(OptionalMode mode) { return mode ? mode->value() + 1 : 0; }
inline OptionalMode ModeOfState(int state) {
  return state > 0 ? OptionalMode(GroupModeIndex(state - 1)) : kUnassigned;
}

/// One run in the build: its data, and what is estimated of it.
struct BuildRun {
  const MappingRun* data = nullptr;
  IndexedVector<FrameIndex, Se2> poses;  ///< T_map_vehicle at every key frame.
  OdometryCalibration odometry;          ///< As estimated for this run.
  SensorBias sensor_bias = SensorBias::Zero();
  SensorDistortion distortion;  ///< As EstimateDistortions() left it.

  double variance_factor = 1.0;  ///< As in GraphRun.

  /// Kept from solve to solve while `odometry` stays close to where they were integrated.
  FrameMotions motions;

  /// The mode of each visit, or kUnassigned: its sightings are clutter, or of a landmark at no
  /// known position.
  IndexedVector<VisitIndex, OptionalMode> assignment;

  /// Visits that hold at no mode, as they may be misread (run_maps/unconfirmed_visits.h). Empty:
  /// none.
  IndexedVector<VisitIndex, bool> unconfirmed;

  bool IsUnconfirmed(VisitIndex visit) const { return !unconfirmed.empty() && unconfirmed[visit]; }
};

/// What a mode beside another costs where solutions are compared, as BuildState::cost: the landmark
/// would have had to move.
inline constexpr double kModeCost = 10.0;

/// A mode of some group.
struct BuildModeRef {
  GroupIndex group;
  GroupModeIndex mode;

  auto operator<=>(const BuildModeRef&) const = default;
};

/// The modes at which a run's visits hold, ascending, each once.
std::vector<BuildModeRef> ModesOf(const BuildRun& run);

/// The mapping build as it is being solved: continuous part (poses, mode positions, calibrations)
/// and discrete part (which mode held at which visit).
struct BuildState {
  IndexedVector<RunIndex, BuildRun> runs;  ///< By begin.
  IndexedVector<GroupIndex, GroupModes> modes;
  std::vector<RejectedRun> left_out;   ///< Runs taken out again, and why (unconstrained_runs.h).
  std::vector<WaitingRuns> waiting;    ///< Without a decided place (place_run_maps.h).
  std::vector<KeptAlternatives> kept;  ///< Of runs in the map (place_run_maps.h).
  SensorCalibration sensor;

  /// What the prior map has of each group; nothing for one that it does not have. Empty without a
  /// prior map.
  IndexedVector<GroupIndex, std::optional<LandmarkGroup>> known;
  Stamp known_at;  ///< Their probabilities hold then.

  /// The same, or null.
  const LandmarkGroup* Known(GroupIndex group) const {
    return !known.empty() && known[group] ? &*known[group] : nullptr;
  }

  /// Of the prior map's modes, as in Graph; see FlatModes.
  std::vector<GraphPrior> priors;

  /// True if a prior map says how long a metre is, or a run is taken from a build that tells its
  /// scale. Modes of the map so far that merely hold a run do not.
  bool in_map_units = false;

  /// What the scale of the prior map is uncertain by beside `priors` (RemoveScale).
  double sd_scale = 0.0;

  MapDisagreement disagreement;  ///< As EstimateRunVariances() left it.

  /// R, two rows a mode: the uncertainty of the distortions adds R Rᵀ to the covariance of the
  /// modes. Empty if they are not those of this build. [m]
  Eigen::MatrixXd distortion_root;

  bool open = false;  ///< As in Graph.

  /// As in Graph.
  double loss_reach = std::numeric_limits<double>::infinity();

  /// Whether all runs are placed in the map: outliers have no pull any more.
  bool placed() const { return std::isfinite(loss_reach); }

  int modes_merged = 0;
  double cost = 0.0;  ///< Half the sum of all losses at the last solve.
};

/// Called with the build as it is between the steps of a long loop; false ends the loop there.
/// None: it goes on to its end.
using StepCallback = std::function<bool(const BuildState&)>;

/// All modes of a build in one list, that of its graph: groups in order, modes in order.
struct FlatModes {
  explicit FlatModes(const BuildState& build);
  ModeIndex Index(GroupIndex group, GroupModeIndex mode) const {
    return first[group] + mode.value();
  }
  /// ModesOf() a run, ascending.
  std::vector<ModeIndex> Of(const BuildRun& run) const;
  std::size_t count() const { return static_cast<std::size_t>(end.value()); }

  IndexedVector<GroupIndex, ModeIndex> first;
  ModeIndex end;
};

/// Of all modes, in that order. [m]
IndexedVector<ModeIndex, Eigen::Vector2d> ModePositions(const BuildState& build);

/// Each vehicle's runs, by its name.
std::map<std::string, std::vector<RunIndex>> RunsByVehicle(const BuildState& build);

/// Whether runs tell the scales of their ranges: by a prior map, or against those of another
/// vehicle.
bool TellsScales(const BuildState& build);

/// Modes from `first` on change by `shift`.
void ShiftPriors(ModeIndex first, int shift, std::vector<GraphPrior>* priors);

/// Moves everything in a build but its prior.
void MoveBuild(const Se2& T_map_old, BuildState* build);

/// The build before any run is in it: without modes, or with those of a prior map.
BuildState StartBuild(std::size_t groups, const SensorCalibration& sensor);
/// @param signatures  Of the groups, ascending; the prior's are among them.
BuildState StartBuild(const std::vector<Signature>& signatures,
                      const MapContent& prior,
                      const SensorCalibration& sensor);

/// Adds a mode to a group; the priors' modes stay right.
GroupModeIndex AddMode(GroupIndex group, const BuildMode& mode, BuildState* build);

/// The continuous part for the present assignment, at its present values.
Graph MakeGraph(const MapperOptions& options, BuildState* build);

/// Solves the continuous part for the present assignment with the odometry as it is integrated.
/// Returns the graph at the solution.
Graph SolveOnce(const MapperOptions& options, BuildState* build, GraphSolver* solver);

/// Solves the continuous part for the present assignment, integrating the odometry anew at the
/// calibration found. Returns the graph at the solution.
Graph SolveContinuous(const MapperOptions& options, BuildState* build);

/// The same, and what the solver keeps goes on from and to other solves.
Graph SolveContinuous(const MapperOptions& options, BuildState* build, GraphSolver* solver);

}  // namespace shiftmap
