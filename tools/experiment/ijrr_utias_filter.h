// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

#include "localizer/models/motion_model.h"
#include "mapstore/geometry/se2.h"
#include "mapstore/run/run.h"

namespace shiftmap {

/// EKF over a pose and the positions of modes, for the joint marginal that IJRR 7.1 gates with.
/// Errors: (ξ of T·Exp(ξ), then x, y of each mode).
class ModeFilter {
 public:
  /// @param pose_sd  (x, y, yaw) of the first pose. [m, m, rad]
  ModeFilter(const Se2& T_map_vehicle, const Eigen::Vector3d& pose_sd);

  /// Adds a mode that is known beforehand and returns its number, from 0 on.
  int AddKnown(const Eigen::Vector2d& p_map_landmark, double sd_m);

  /// Adds a mode where an observation sees it and returns its number.
  int AddSeen(const Observation& observation, const Eigen::Matrix2d& cov_z);

  void Move(const MotionIncrement& motion);

  /// νᵀ S⁻¹ ν of an observation against a mode.
  double SquaredDistance(const Observation& observation,
                         const Eigen::Matrix2d& cov_z,
                         int mode) const;

  void Update(const Observation& observation, const Eigen::Matrix2d& cov_z, int mode);

  const Se2& T_map_vehicle() const { return T_map_vehicle_; }
  const std::vector<Eigen::Vector2d>& modes() const { return modes_; }

 private:
  Se2 T_map_vehicle_;
  std::vector<Eigen::Vector2d> modes_;
  Eigen::MatrixXd cov_;
};

}  // namespace shiftmap
