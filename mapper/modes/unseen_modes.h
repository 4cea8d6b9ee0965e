// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "mapper/modes/missed_detection_model.h"
#include "mapstore/core/stamp.h"
#include "mapstore/map/calibration.h"
#include "mapstore/map/evidence.h"
#include "mapstore/map/mode_filter.h"
#include "mapstore/map/visibility.h"
#include "mapstore/run/trajectory.h"

namespace shiftmap {

/// A run that an ancestor of the map was built from.
struct OlderRun {
  std::string name;
  std::string sha256;
  std::string uuid;
  std::string vehicle;
  Stamp begin;
  Stamp end;
  std::vector<StampedPose> trajectory;  ///< T_map_vehicle; may be thinned.
};

/// What older runs say of a mode that was found after them: nothing was seen there.
struct OlderEvidence {
  OlderRun run;  ///< Without its trajectory.
  std::vector<VisitEvidence> evidence;
};

/// A mode that no older run knew.
struct NewMode {
  Signature signature;
  ModeNumber number;
  Eigen::Vector2d p_map_landmark = Eigen::Vector2d::Zero();  ///< [m]
  Visibility scans;  ///< From where the runs that found it saw it.
};

/// The passes of older runs that had the place of a new mode well in view, as visits without a
/// sighting, IJRR (28): against `absent` the mode loses LogMissedPasses(). So a landmark that was
/// away and then at a place that nobody knew was away, and not there already.
///
/// A run that saw the landmark has such a visit too: where the landmark was, it was not there.
/// @param modes       By signature and number.
/// @param ledger      Rows of older runs by OlderRun::sha256; others do not matter.
/// @param pass_gap_s  A place that was out of view for longer is in view anew. [s]
/// Returns the runs that have such visits, in the order given.
std::vector<OlderEvidence> FindUnseenModes(const std::vector<OlderRun>& runs,
                                           const std::vector<NewMode>& modes,
                                           const std::vector<EvidenceRow>& ledger,
                                           double pass_gap_s,
                                           const SensorCalibration& sensor,
                                           const MissedDetectionOptions& options);

}  // namespace shiftmap
