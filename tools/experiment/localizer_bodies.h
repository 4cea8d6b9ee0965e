// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "mapstore/geometry/covariance.h"
#include "mapstore/map/calibration.h"
#include "proto/core/status.h"
#include "tools/experiment/localizer_utias.h"

namespace shiftmap {

/// Recorded robots on maps in which several landmarks are displaced together.
///
/// Landmarks of one rack move as one rigid body. They agree with each other, so that a vehicle that
/// sees no others finds itself displaced: a wrong pose explains them as well as a moved rack does.
enum class DisplacedPart {
  kNothing,
  kRack,    ///< The sixth of the landmarks that is nearest to one of them; at least three.
  kSide,    ///< The quarter of them that is farthest in one direction; at least three.
  kLayout,  ///< The map is that of another data set.
};

/// Every robot that is localized, and the landmarks' places by TrueShift::layout. [m]
struct UtiasRecordings {
  std::vector<TrueShift> shifts;
  std::vector<Layout> layouts;
};

/// A map that is believed, and a start that is known well.
inline LayoutOptions DisplacedOptions() {
  return {.stale_probability = 0.97,
          .sd_start_m = 0.2,
          .sd_start_rad = 0.1,
          .sd_survey_m = 0.03,
          .settled_after_s = 30.0};
}

/// One robot on one map.
struct DisplacedRun {
  const TrueShift* shift = nullptr;  ///< Must outlive this.
  Layout places;                     ///< Where the landmarks stand. [m]
  Layout mapped;                     ///< Where the map has them. [m]
  PoseWithCovariance start;
};

/// Draws the maps and starts of all robots. A body is displaced in a drawn direction; in every
/// second draw, from the first on, it is also turned about its mean.
/// @param displaced_m  Of a rack or a side. [m]
/// @param draws        Per robot, of a rack or a side. The others are one map, or one per layout.
/// @param next_seed    Of the first run; on return, that of the run after the last.
std::vector<DisplacedRun> DrawDisplacedRuns(const UtiasRecordings& recordings,
                                            DisplacedPart part,
                                            double displaced_m,
                                            int draws,
                                            const LayoutOptions& options,
                                            std::uint64_t* next_seed);

/// What localizers made of displaced maps, from LayoutOptions::settled_after_s on.
struct DisplacedTally {
  std::int64_t runs = 0;
  std::int64_t poses = 0;
  std::int64_t wrong = 0;  ///< More than half a metre from the truth.
  std::int64_t sure = 0;   ///< Of the wrong: not LOST, and the truth outside of 0.999 of the pose.
  std::int64_t lost = 0;   ///< Poses in this state.
  std::int64_t unknown = 0;  ///< Poses in UNKNOWN_CHANGE.
  double worst_m = 0.0;
  double nees_sum = 0.0;  ///< Each pose counts with at most 1000.
  std::int64_t decisions = 0;
  std::int64_t wrong_decisions = 0;  ///< Absent where the map has it, or a mode where it is not.

  void Add(const DisplacedTally& other);
};

/// Localizes the first ten minutes of each run.
/// Errors: Localizer::Process()'s. Determinism: independent of the number of threads.
StatusOr<DisplacedTally> TallyDisplaced(const std::vector<DisplacedRun>& runs,
                                        const Calibration& calibration,
                                        const LayoutOptions& options,
                                        int threads);

}  // namespace shiftmap
