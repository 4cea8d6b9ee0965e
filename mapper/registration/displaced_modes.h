// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "mapper/alignment/consensus.h"
#include "mapper/alignment/explanation.h"
#include "mapper/mapper_options.h"
#include "mapper/registration/mode_match.h"
#include "mapper/run_maps/run_map.h"
#include "mapper/state/build_state.h"
#include "mapstore/map/joint_covariance.h"

namespace shiftmap {

/// Which modes of a run map are of landmarks that stand elsewhere than the prior map has them.
struct DisplacedModes {
  /// Whether the likeliest partition displaces a mode. False for modes that meet no mode of the
  /// prior map.
  ModeFlags displaced;

  /// One entry for each neighbourhood in which another partition is likely and places the run 3 cm
  /// or more elsewhere. Neighbourhoods that are decided have none.
  std::vector<Explanations> explanations;
};

/// Which modes of a run map are of landmarks that stand elsewhere than the prior map has them,
/// decided together by FindDisplaced(): for all of them at once, or where they are hundreds for
/// those of one neighbourhood after the other.
///
/// That takes a run's landmarks for linear in its errors, which they are not once they are to turn
/// by some tenths of a radian: a run that lost its heading between two rooms has the second one on
/// an arc, and on the tangent to it landmarks that stayed seem to have moved. A run that may have
/// is first deformed onto what it may have met (FitDeformedRunMap), another if the landmarks that
/// stayed are to deform it far; and it is decided, or decided again, on what the run by itself says
/// around there, until nothing changes.
///
/// @param map        Has the prior map's modes.
/// @param alignment  By which the run map is in the map frame.
/// @param run_map    In the map frame; not deformed as of RunMapAlignment. Left deformed as
/// decided.
DisplacedModes FindDisplacedModes(const MapperOptions& options,
                                  const JointCovariance& prior_covariance,
                                  const BuildState& map,
                                  const Alignment& alignment,
                                  RunMap* run_map);

}  // namespace shiftmap
