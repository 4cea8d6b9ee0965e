// SPDX-License-Identifier: Apache-2.0
//
// Whitened residuals of the graph and their Jacobians, in the tangent space of the poses:
// T_map_vehicle·Exp(ξ), order (x, y, yaw), in the vehicle frame.
#pragma once

#include <Eigen/Core>

#include "localizer/models/motion_model.h"
#include "mapper/graph/graph.h"
#include "mapper/graph/robust_loss.h"
#include "mapper/index.h"
#include "mapstore/geometry/arc_factors.h"

namespace shiftmap {

/// An observation whose squared standardized residual is beyond this quantile of its χ² is an
/// outlier: it says nothing about noise, detection or support.
inline constexpr double kInlierProbability = 0.999;

/// The vehicle stood, by its odometry. Such a motion says nothing about the noise of driving: the
/// noise of a vehicle that stands is a fixed share of it (AppendMotion()).
inline bool Stands(const Se2& T_begin_end) {
  return T_begin_end.translation().isZero(0.0) && T_begin_end.yaw() == 0.0;
}

/// Whether a motion says something about that noise: odometry measured it, and the vehicle drove.
inline bool TellsNoise(const MotionIncrement& motion) {
  return motion.measured && !Stands(motion.T_begin_end);
}

/// r = Σ^(-1/2) diag(e^s, e^s, 1) Log( (T_i Δ(c))⁻¹ T_j ),  Δ(c) = Δ Exp(J c).
///
/// The noise of odometry is known in the units of length of the run's own sensor, whose ranges are
/// e^s as long; so a smaller world has no smaller residuals (mapper/METHOD.md, 3). The root is
/// upper triangular: the third row is yaw alone, the others are what of x and y it does not
/// explain.
class MotionResidual {
 public:
  struct Linear {
    Eigen::Vector3d r;
    Eigen::Matrix3d J_i;
    Eigen::Matrix3d J_j;
    Eigen::Matrix<double, 3, 4> J_calibration;  ///< By (correction c, log range scale s).
  };

  /// @param variance_factor  By which Σ is multiplied.
  explicit MotionResidual(const MotionIncrement& motion, double variance_factor = 1.0);

  /// @param R_map_i  Of T_map_i, here and below: many residuals share its sine and cosine.
  Linear At(const Se2& T_map_i,
            const Eigen::Matrix2d& R_map_i,
            const Se2& T_map_j,
            const Eigen::Vector3d& correction,
            double log_range_scale) const;

  Linear At(const Se2& T_map_i,
            const Se2& T_map_j,
            const Eigen::Vector3d& correction,
            double log_range_scale) const {
    return At(T_map_i, T_map_i.Rotation(), T_map_j, correction, log_range_scale);
  }

  /// The r of it alone.
  Eigen::Vector3d ResidualAt(const Se2& T_map_i,
                             const Eigen::Matrix2d& R_map_i,
                             const Se2& T_map_j,
                             const Eigen::Vector3d& correction,
                             double log_range_scale) const;

 private:
  // Odometry with the correction, and how the poses differ from it.
  struct Difference {
    Se2::Step shift;               // Of the correction.
    Eigen::Matrix2d R_i_odometry;  // Odometry's end.
    Eigen::Vector2d p_i_j;
    Se2 error;          // T_odometry_j.
    ArcFactors arc;     // Of its yaw.
    Eigen::Matrix2d A;  // Upper left block of the inverse of the right Jacobian of Exp at r.
    Eigen::Vector3d r;  // Log(error), not whitened.
  };

  Difference DifferenceAt(const Se2& T_map_i,
                          const Eigen::Matrix2d& R_map_i,
                          const Se2& T_map_j,
                          const Eigen::Vector3d& correction) const;
  Eigen::Matrix3d Whitening(double log_range_scale) const;

  Se2 T_i_j_;
  Eigen::Matrix2d R_i_j_;  // Rotation of T_i_j_.
  Eigen::Matrix3d J_calibration_;
  Eigen::Matrix3d sqrt_information_;
};

/// r = R^(-1/2) (z - h(T, p, b)), bearing wrapped.
class ObservationResidual {
 public:
  struct Linear {
    Eigen::Vector2d r;
    Eigen::Matrix<double, 2, 3> J_pose;
    Eigen::Matrix2d J_landmark;
    Eigen::Matrix<double, 2, 3> J_bias;
  };

  /// @param observation  Must outlive the residual.
  explicit ObservationResidual(const GraphObservation& observation);
  Linear At(const Se2& T_map_vehicle,
            const Eigen::Matrix2d& R_map_vehicle,
            const Eigen::Vector2d& p_map_landmark,
            const SensorBias& bias) const;

  Linear At(const Se2& T_map_vehicle,
            const Eigen::Vector2d& p_map_landmark,
            const SensorBias& bias) const {
    return At(T_map_vehicle, T_map_vehicle.Rotation(), p_map_landmark, bias);
  }

  /// The r of it alone.
  Eigen::Vector2d ResidualAt(const Se2& T_map_vehicle,
                             const Eigen::Matrix2d& R_map_vehicle,
                             const Eigen::Vector2d& p_map_landmark,
                             const SensorBias& bias) const;

  /// R^(-1/2) dz, of changes dz of the observation.
  Eigen::Matrix2d Whitened(const Eigen::Matrix2d& dz) const { return sqrt_information_ * dz; }

 private:
  const GraphObservation* observation_;
  Eigen::Matrix2d sqrt_information_;
};

/// The losses of the observations of each run.
IndexedVector<RunIndex, RobustLoss> LossesOf(const Graph& graph);

}  // namespace shiftmap
