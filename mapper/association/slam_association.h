// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "mapper/association/joint_compatibility.h"
#include "mapper/frontend/slam_state.h"
#include "mapstore/run/run.h"

namespace shiftmap {

enum class AssociationMethod {
  kNearest,  ///< AssociateNearest(), T-IV IX-E.
  kJoint,    ///< AssociateJointly().
};

/// Which landmarks of a SlamState some observations of a scan are of.
struct SlamAssociation {
  std::vector<SlamPair> pairs;  ///< Observations of the scan that was passed.
  std::vector<int> paired;      ///< Of each pair, the index in the scan.
  std::vector<int> left;        ///< Indices of those that gate with no landmark.
  bool complete = true;         ///< JointAssociation::complete.
};

/// Pairs observations with landmarks, each landmark at most once.
/// @param observations  Indices in `scan`.
/// @param landmarks     Active ones.
/// @param slack_m       A landmark farther from where an observation puts it is not asked. [m]
SlamAssociation AssociateLandmarks(const Scan& scan,
                                   std::span<const int> observations,
                                   std::span<const int> landmarks,
                                   double slack_m,
                                   AssociationMethod method,
                                   const CompatibilityOptions& options,
                                   const SlamState& state);

/// How far from where it is expected a landmark at `range_m` may appear: by the pose's uncertainty,
/// and by its own up to five metres. [m]
double PlaceSlack(const SlamState& state, double range_m);

}  // namespace shiftmap
