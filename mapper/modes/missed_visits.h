// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

#include "mapper/modes/missed_detection_model.h"
#include "mapper/state/build_state.h"
#include "mapstore/core/stamp.h"

namespace shiftmap {

/// A stretch of a run, between two visits of a group, in which modes of it were in view and no
/// sighting was made.
struct MissedVisit {
  RunIndex run;
  Stamp begin;  ///< First and last scan with a mode in view.
  Stamp end;
  Eigen::VectorXd
      log_likelihoods;  ///< Per state of the group, `absent` first, as for visits. [nat]
};

/// The scans of a run that had a mode of a group well in view while the landmark stood there.
struct SeenMode {
  BuildModeRef mode;
  Visibility scans;
};

struct MissedVisits {
  IndexedVector<GroupIndex, std::vector<MissedVisit>> by_group;  ///< Over all runs, by time.
  IndexedVector<RunIndex, std::vector<SeenMode>> seen_by_run;    ///< By mode, each once.
};

/// The missed visits of every group over all runs. A landmark that a run saw at the same mode
/// before and after did stand there: that stretch tells how visible it is, and is no missed visit.
///
/// @param known  What earlier runs tell of how visible modes are. None: nothing.
///
/// A scan counts if it saw another landmark where the map has it: a sensor may log nothing where it
/// sees nothing, and a scan with a wrong pose sees nothing where it is expected.
///
/// Cost: one look at the modes around the vehicle per key frame.
MissedVisits FindMissedVisits(const BuildState& build,
                              double pass_gap_s,
                              const MissedDetectionOptions& options,
                              const IndexedVector<ModeIndex, Visibility>& known = {});

}  // namespace shiftmap
