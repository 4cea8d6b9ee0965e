// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "mapstore/core/stamp.h"
#include "mapstore/map/evidence.h"
#include "mapstore/map/visibility.h"
#include "mapstore/run/trajectory.h"

namespace shiftmap {

/// One pose of a run's trajectory as the mapper estimated it.
using TrajectoryPose = StampedPose;

/// A run that a version was built from.
struct RunRecord {
  std::string name;    ///< The log file's stem.
  std::string sha256;  ///< Of the log file, in hex.
  std::string vehicle;
  Stamp begin;
  Stamp end;
  std::vector<TrajectoryPose> trajectory;  ///< Thinned for pictures; may be empty.

  /// What its visits say of the version's landmarks, in any order. Goes into the ledger, and does
  /// not come back with the provenance.
  std::vector<VisitEvidence> evidence = {};

  std::string uuid = {};  ///< RunInfo::uuid.

  /// How well it saw the version's modes; each once. As `evidence`, it does not come back.
  std::vector<ModeVisibility> visibility = {};

  /// What tells runs apart: the UUID, or else the hash.
  const std::string& identity() const { return uuid.empty() ? sha256 : uuid; }
};

}  // namespace shiftmap
