// SPDX-License-Identifier: Apache-2.0
//
// The field of view of a lidar by what its scan covers: a landmark behind a wall is not in view.
// Beside the sector model, detection_model.h.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "mapstore/geometry/covariance.h"
#include "mapstore/geometry/se2.h"

namespace shiftmap {

struct ScanPolygonOptions {
  /// The area is grown by this away from the lidar, T-IV IX-D: landmarks are on what the beams hit,
  /// so that without it half of the samples of a landmark in plain view fall outside. [m]
  double grown_m = 0.5;

  /// Samples of pose and landmark, T-IV IX-D. The probability is a multiple of their inverse.
  int samples = 100;

  std::uint64_t seed = 1;
};

/// The area that a scan covers, as seen from the vehicle.
class ScanPolygon {
 public:
  /// @param border_lidar   What the beams hit, by strictly ascending bearing in [-π, π], lidar
  ///                       frame; for a beam without return where it could have hit. [m]
  /// @param all_round      The beams cover the full circle. If not, the sector behind the lidar,
  ///                       from the last beam to the first, is outside.
  /// @param grown_m        As in ScanPolygonOptions.
  ScanPolygon(std::span<const Eigen::Vector2d> border_lidar,
              const Se2& T_vehicle_lidar,
              bool all_round,
              double grown_m);

  /// @param p_vehicle  Vehicle frame. [m]
  bool Contains(const Eigen::Vector2d& p_vehicle) const;

 private:
  Se2 T_lidar_vehicle_;
  std::vector<Eigen::Vector2d> border_;  // Lidar frame, grown.
  std::vector<double> bearings_;         // Of the border, ascending.
};

/// P_FOV of T-IV IX-D: the share of sampled pairs of a pose and a landmark in which the landmark is
/// in the area that the scan covers from that pose. The samples of every call come from the same
/// draws, so that equal input gives equal output, and close input close output.
class ScanPolygonFieldOfView {
 public:
  /// Precondition: samples >= 1.
  explicit ScanPolygonFieldOfView(const ScanPolygonOptions& options = {});

  /// @param pose                At the time of the scan.
  /// @param p_map_landmark      [m]
  /// @param cov_p_map_landmark  Taken for independent of the pose, as the paper does. [m²]
  /// @return 0 if a value is NaN.
  double operator()(const ScanPolygon& polygon,
                    const PoseWithCovariance& pose,
                    const Eigen::Vector2d& p_map_landmark,
                    const Eigen::Matrix2d& cov_p_map_landmark) const;

 private:
  // Standard normal: pose (x, y, yaw), then landmark (x, y).
  std::vector<Eigen::Matrix<double, 5, 1>> draws_;
};

}  // namespace shiftmap
