// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

#include "mapper/modes/missed_detection_model.h"
#include "mapstore/map/calibration.h"
#include "mapstore/map/evidence.h"
#include "mapstore/map/mode_filter.h"
#include "mapstore/map/run_record.h"
#include "mapstore/map/visibility.h"

namespace shiftmap {

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
/// @param ledger      Rows of older runs by RunRecord::sha256; others do not matter.
/// @param pass_gap_s  A place that was out of view for longer is in view anew. [s]
/// Returns the runs that have such visits, in the order given.
std::vector<RunRecord> FindUnseenModes(const std::vector<RunRecord>& runs,
                                       const std::vector<NewMode>& modes,
                                       const std::vector<EvidenceRow>& ledger,
                                       double pass_gap_s,
                                       const SensorCalibration& sensor,
                                       const MissedDetectionOptions& options);

}  // namespace shiftmap
