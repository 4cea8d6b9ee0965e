// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "mapper/alignment/consensus.h"
#include "mapper/map_problem.h"
#include "mapper/mapper_options.h"
#include "mapper/rejected_run.h"
#include "mapstore/map/map_snapshot.h"

namespace shiftmap {

/// A run mapped by itself, waiting for its place in the common frame.
struct Submap {
  MapProblem problem;
  std::vector<AlignmentPoint> points;  ///< Its modes, in the flat order of the problem.
  Eigen::MatrixXd covariance;          ///< Joint, of the points, relative to them as a whole. [m²]
};

/// The covariance of a submap's modes, as Submap::covariance, at their present values. Nothing if
/// these have gone astray so far that there is none.
std::optional<Eigen::MatrixXd> SubmapCovariance(const MapperOptions& options, MapProblem* problem);

/// Nothing if the run does not determine its own landmarks.
/// @param problem  As MapSingleRun() leaves it.
std::optional<Submap> MakeSubmap(const MapperOptions& options, MapProblem problem);

/// Moves everything in a problem but its prior.
void MoveProblem(const Se2& T_map_old, MapProblem* problem);

/// The problem before any run is in it: without modes, or with those of a prior map.
/// @param signatures  Of the groups, ascending; the prior's are among them.
MapProblem StartProblem(std::size_t groups, const SensorCalibration& sensor);
MapProblem StartProblem(const std::vector<Signature>& signatures,
                        const MapContent& prior,
                        const SensorCalibration& sensor);

/// Places submaps one after the other, always the one that shares most signatures with what is
/// there, and adds them to the problem. Whenever the runs in the map are twice as many as the last
/// time, from four on, and once more when some are left that do not align, what is there is solved
/// as a whole (SettleModes). One that does not align is tried again once the map has
/// other modes of its signatures. A mode of a submap becomes one that is there, or a mode beside
/// it:
///
/// - against modes of the prior map that is decided for the whole submap at once, FindDisplaced();
/// - against modes that other runs of this build brought, by a gate on each.
///
/// What aligns with nothing is rejected, and so is what the landmarks that moved leave without two
/// that did not.
/// @param go_on  Asked before each submap; if it says no, the others are neither placed nor
/// rejected.
void PlaceSubmaps(const MapperOptions& options,
                  const std::optional<MapContent>& prior,
                  std::vector<Submap> submaps,
                  MapProblem* problem,
                  std::vector<RejectedRun>* rejected,
                  const GoOn& go_on = {});

}  // namespace shiftmap
