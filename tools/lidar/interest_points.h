// SPDX-License-Identifier: Apache-2.0
//
// Points of a 2D scan that are found again from elsewhere: where the scan bends.
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "proto/core/status.h"
#include "tools/lidar/scan_points.h"

namespace shiftmap {

struct InterestPointOptions {
  /// Smallest F of a peak: F_min of T-IV IX-B. F is at most 1/e = 0.3679; a corner of two long
  /// walls that turns by φ has 2|A - α|/t = 1.596 sin(φ/2), so that 0.367 takes corners that turn
  /// by 71.4 degrees or more. Lowering it takes flatter ones. In (0, 1/e).
  double min_response = 0.367;

  /// Least distance between two points: F_dist of T-IV IX-B, which names no unit. [m]
  double min_separation_m = 0.12;

  /// Scales are base_scale_m · scale_step^k for k in [0, scales). [m]
  double base_scale_m = 0.2;
  double scale_step = 1.4;
  int scales = 5;

  /// Neighbouring beams that hit further apart than this hit two surfaces. [m]
  double max_gap_m = 0.25;

  /// Also take where a surface ends before a farther one. The shadow's edge on the farther one
  /// moves with the vehicle and is never taken.
  bool edges = true;

  /// Errors: kInvalidArgument naming the first member out of range.
  Status Validate() const;
};

struct InterestPoint {
  int beam = 0;
  Eigen::Vector2d p_lidar = Eigen::Vector2d::Zero();  ///< What the beam hit, lidar frame. [m]
  double scale_m = 0.0;                               ///< At which it was found.
  bool edge = false;                                  ///< The end of a surface, else a corner.
};

/// The curvature detector of Tipaldi and Arras, "FLIRT - Interest regions for 2D range data",
/// ICRA 2010, as T-IV IX-B uses it. With α(s) the scan over its arc length and A(s; t) its mean
/// under a Gaussian of standard deviation t around s,
///
///   F(s; t) = x exp(-x),   x = 2 |A(s; t) - α(s)| / t,
///
/// is largest at x = 1. A sharper corner therefore has a peak of F on either flank; its point is
/// put between them, at the peak of x. So a point is a local maximum of x along the scan with x at
/// or above the smaller root of x exp(-x) = F_min. Scales are gone through from fine to coarse: a
/// point within F_dist of one that is there already, or within its own scale of one of a finer
/// scale, is the same.
/// @param ranges_m  One per beam. [m]
/// @return By beam.
/// Precondition: options and sensor are valid. Determinism: same input, same output.
std::vector<InterestPoint> DetectInterestPoints(std::span<const double> ranges_m,
                                                const LidarSensor& sensor,
                                                const InterestPointOptions& options);

}  // namespace shiftmap
