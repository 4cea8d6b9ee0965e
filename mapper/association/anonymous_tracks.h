// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <functional>
#include <vector>

#include "mapper/association/joint_compatibility.h"
#include "mapper/frontend/usable_sightings.h"
#include "mapstore/map/calibration.h"
#include "mapstore/run/run.h"
#include "mapstore/run/trajectory.h"
#include "proto/core/status.h"

namespace shiftmap {

struct AssociationOptions {
  /// Associate observations without a signature; else they are left out. Off by default: where
  /// signatures are there to be read, an observation without one is often a landmark whose
  /// signature could not be read, which moves, and this takes it for one that stands.
  bool associate = false;

  CompatibilityOptions compatibility = {};

  /// Joint compatibility, or else nearest neighbours, the baseline.
  bool joint = true;

  /// An observation begins a track if it is beyond this quantile of every track's gate, ...
  double isolation_probability = 0.9999;

  /// ... and as far from all of them. What is between is left out. [m]
  double separation_m = 1.0;

  /// A track is tentative until it has as many sightings; if it has not got them within so many
  /// scans, it is dropped.
  int confirm_sightings = 4;
  int confirm_within_scans = 15;

  /// Tracks with fewer sightings in the whole run are dropped.
  int min_sightings = 10;

  /// Two tracks that are as close, not told apart by their covariance and never seen in one scan
  /// are one landmark. [m]
  double duplicate_distance_m = 1.0;

  /// Of a run's anonymous observations, the share that must belong to a track for any to be used:
  /// a pose that is lost by wrong associations finds no landmark where it expects it, and goes on
  /// to lay a second map.
  double min_associated_share = 0.5;

  /// Errors: kInvalidArgument naming the first member out of range.
  Status Validate() const;
};

/// What became of the anonymous observations of a run.
struct AnonymousAssociation {
  std::vector<Eigen::Vector2d> tracks;     ///< p_start_landmark of each, by first sighting.
  std::vector<std::vector<int>> track_of;  ///< [scan][observation]: index in `tracks`, or -1.
  std::vector<StampedPose> trajectory;     ///< T_start_vehicle at every scan.
  int observations = 0;                    ///< Anonymous ones.
  int associated = 0;                      ///< Of those, with a track.
  int dropped_tracks = 0;                  ///< Never confirmed, or seen too rarely.
};

/// Follows the landmarks of a run that have no signature by EKF-SLAM (SlamState) with joint
/// compatibility, AssociateJointly(). Landmarks with a signature are in the same state, so that
/// each kind holds the pose for the other.
///
/// Per scan: prediction, observations with signatures, joint association of the others with the
/// confirmed tracks near by, then of what is left with tentative ones; what is far from all of them
/// begins a track. Sightings that FindUsableSightings() leaves out are not used.
/// @param on_step  Called between scans; false ends the search with the tracks so far.
/// Precondition: the run and the options are valid. Determinism: same input, same output.
AnonymousAssociation AssociateAnonymous(const Run& run,
                                        const Calibration& calibration,
                                        const AssociationOptions& options,
                                        const FrontEndOptions& front_end = {},
                                        const std::function<bool()>& on_step = {});

}  // namespace shiftmap
