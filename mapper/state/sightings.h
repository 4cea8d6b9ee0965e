// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "localizer/models/observation_model.h"
#include "mapper/frontend/mapping_run.h"
#include "mapper/mapper_options.h"
#include "mapper/state/build_state.h"
#include "mapper/state/visit_ref.h"

namespace shiftmap {

/// Where most sightings of a list agree: the mean of those around the sighting with most
/// neighbours.
struct VisitCluster {
  Eigen::Vector2d centre = Eigen::Vector2d::Zero();  ///< [m]
  int count = 0;
};
VisitCluster DensestCluster(const std::vector<Eigen::Vector2d>& positions, double radius_m);

/// Innovation of a sighting against a position, the run's sensor bias taken off.
Innovation SightingInnovation(const BuildRun& run,
                              const Sighting& sighting,
                              const Eigen::Vector2d& p_map_landmark);

/// Position of the mode that a sighting's visit is assigned to. [m]
/// Precondition: it is assigned to one.
const Eigen::Vector2d& AssignedPosition(const BuildState& build,
                                        const BuildRun& run,
                                        const Sighting& sighting);

/// True if a sighting is explained by the mode of its visit: its squared standardized residual is
/// below the 99.9 % quantile.
bool IsInlier(const BuildState& build, const BuildRun& run, const Sighting& sighting);

/// Sightings of a visit that its mode explains.
std::ptrdiff_t CountInliers(const BuildState& build, const VisitRef& ref);

/// Positions of a visit's sightings as seen from the present poses, the run's sensor bias taken
/// off. [m]
std::vector<Eigen::Vector2d> VisitPositions(const BuildRun& run, const MappingVisit& visit);

/// Where most of these agree.
VisitCluster ClusterOf(const BuildRun& run, const MappingVisit& visit, double radius_m);

/// Whether a visit has sightings enough for a mode. Shorter ones may be of a misread signature.
bool MakesMode(const ModeOptions& options, const MappingVisit& visit);

}  // namespace shiftmap
