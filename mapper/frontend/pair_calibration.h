// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapper/frontend/mapping_run.h"
#include "mapstore/map/calibration.h"

namespace shiftmap {

/// A first estimate of what a run's odometry gets wrong and of its sensor's noise, from pairs of
/// sightings of one landmark a moment apart. It needs neither a map nor a trajectory, and a
/// landmark that moved between visits does no harm.
///
/// For a pair at times t1 < t2 the landmark at q1 must appear at q2 = Exp(S ξ)⁻¹ q1, where ξ is the
/// odometry twist between t1 - lag and t2 - lag and S scales its v and ω parts. Scales by
/// iteratively reweighted least squares at each lag of a grid, with priors of sd_log_scale and
/// kLagSd about the fallback; the best lag is refined by a parabola. What then remains between a
/// sighting and one shortly after, of a vehicle that moves, is the noise of both: the median of it
/// is the sensor's, and a little of odometry's, whose own is left as it is. Fewer than 30 pairs
/// leave `fallback` as it is.
Calibration CalibrateFromPairs(const MappingRun& run, const Calibration& fallback);

}  // namespace shiftmap
