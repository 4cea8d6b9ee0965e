// SPDX-License-Identifier: Apache-2.0
//
// The protocol of IJRR 8.2.1: recorded runs of UTIAS MRCLAM among surveyed landmarks, some of which
// the map has at a wrong place.
#pragma once

#include <Eigen/Core>
#include <map>
#include <string>
#include <vector>

#include "mapper/frontend/mapping_run.h"
#include "mapstore/core/ids.h"
#include "mapstore/map/map_snapshot.h"
#include "mapstore/run/run.h"
#include "mapstore/run/trajectory.h"
#include "proto/core/status.h"

namespace shiftmap {

using LandmarkPlaces = std::map<Signature, Eigen::Vector2d>;

/// What of a recording takes part, IJRR 8.2.
struct UtiasProtocol {
  double start_s = 0.0;  ///< From where odometry and motion capture have begun.
  double duration_s = 340.0;
  double max_range_m = 5.0;      ///< Observations from further away are left out.
  double max_bearing_rad = 0.4;  ///< And those more to the side.
  int moved_landmarks = 4;       ///< That stand elsewhere than the map says.
  double prior_sd_m = 0.05;      ///< Of each coordinate in the map.
};

/// One recorded run of the experiment.
struct UtiasCase {
  int dataset = 0;
  int robot = 0;
  double start_s = 0.0;  ///< UtiasProtocol::start_s.
  Run run;
  MappingRun frames;  ///< The same by key frames and visits; groups: `signatures`.
  IndexedVector<GroupIndex, Signature> signatures;  ///< Ascending: all landmarks of the data set.
  std::vector<StampedPose> truth;                   ///< Motion capture.
  LandmarkPlaces landmarks;                         ///< Surveyed.
  std::vector<Signature> moved;  ///< Ascending: the group that the map has displaced.
};

/// Reads `<data>/MRCLAM_Dataset<N>`. The run begins `start_s` after the odometry or, where motion
/// capture begins later, after that. Errors: as ReadUtias; kInvalidArgument if nothing is left to
/// see.
StatusOr<UtiasCase> LoadUtiasCase(const std::string& data,
                                  int dataset,
                                  int robot,
                                  const UtiasProtocol& protocol);

/// The run without observations outside of the field of view; its scans stay.
Run WithinFieldOfView(Run run, double max_range_m, double max_bearing_rad);

/// The `count` places that stand closest together: least sum of squared distances between any two.
/// Ascending. Precondition: 1 <= count <= places.size() <= 20.
std::vector<Signature> ClosestTogether(const LandmarkPlaces& places, int count);

/// The surveyed places with those of `moved` displaced along x.
LandmarkPlaces Displaced(LandmarkPlaces places,
                         const std::vector<Signature>& moved,
                         double delta_m);

/// A map of one mode per place, as `shiftmap-mapper import` makes it of a survey.
/// @param sd_m  Of each coordinate. [m]
MapContent SurveyMap(const LandmarkPlaces& places, double sd_m, Stamp stamp);

}  // namespace shiftmap
