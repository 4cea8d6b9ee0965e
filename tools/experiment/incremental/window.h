// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "mapper/graph/graph.h"
#include "mapper/graph/residuals.h"
#include "mapstore/geometry/se2.h"

namespace shiftmap {

/// What a vehicle's odometry and sensor get wrong, order (log scale_v, log scale_omega, lag [s],
/// log range scale, bearing offset [rad], range curvature [1/rad²]).
using CalibrationVector = Eigen::Vector<double, kRunCalibration>;

/// The mode of an observation that is taken for clutter so far.
inline constexpr int kNoMode = -1;

/// An observation in the window.
struct WindowObservation {
  int group = 0;            ///< Of which landmark.
  int number = 0;           ///< Counted over all frames, in the order in which they were added.
  int mode = kNoMode;       ///< Index in Window::modes.
  GraphObservation factor;  ///< What was seen; its indices are not used.

  /// Of where it saw the landmark in the map, with the uncertainty of the pose then. [m²]
  Eigen::Matrix2d cov_p_map = Eigen::Matrix2d::Identity();
};

/// A pose in the window and what was seen from it.
///
/// Estimates are steps from an origin, where Jacobians are taken: T_map_vehicle = origin·Exp(step).
struct WindowFrame {
  Se2 origin;
  Eigen::Vector3d step = Eigen::Vector3d::Zero();
  Se2 T_map_vehicle;
  std::optional<MotionResidual> motion;  ///< To the next frame; none for the newest.
  std::vector<WindowObservation> observations;
};

/// A mode: p_map_landmark = origin + step. [m]
struct WindowMode {
  Eigen::Vector2d origin = Eigen::Vector2d::Zero();
  Eigen::Vector2d p_map_landmark = Eigen::Vector2d::Zero();

  /// What is known of a mode that no observation is switched to: where it was first seen.
  Eigen::Vector2d birth = Eigen::Vector2d::Zero();
  Eigen::Matrix2d birth_cov = Eigen::Matrix2d::Identity();

  bool merged = false;  ///< Into another: it takes part in nothing.
};

/// Everything continuous that is being estimated.
struct Window {
  std::vector<WindowFrame> frames;  ///< By time.
  std::vector<WindowMode> modes;    ///< In the order in which they were added.
  CalibrationVector calibration_origin = CalibrationVector::Zero();
  CalibrationVector calibration = CalibrationVector::Zero();

  /// Of the first frame, until frames are dropped.
  std::optional<MotionResidual> start;
  Se2 T_map_start;

  /// Residual, in standard deviations, at which the loss of an observation turns from square to
  /// logarithm (Cauchy).
  double loss_scale = 2.5;
};

/// Columns of normal equations over a pose ξ, the calibration, and the modes.
inline constexpr Eigen::Index kPoseColumn = 0;
inline constexpr Eigen::Index kCorrectionColumn = 3;
inline constexpr Eigen::Index kBiasColumn = 6;
inline constexpr Eigen::Index kModeColumns = 9;
inline Eigen::Index ModeColumn(int mode) { return kModeColumns + 2 * Eigen::Index{mode}; }

/// What all frames before one say of it, of the calibration and of the modes: the quadratic
/// ½ dᵀ H d - bᵀ d over steps d from the origins, in the columns above. Modes that are not in it
/// yet have no columns.
struct CarriedSystem {
  Eigen::MatrixXd H = Eigen::MatrixXd::Zero(kModeColumns, kModeColumns);  ///< Lower triangle.
  Eigen::VectorXd b = Eigen::VectorXd::Zero(kModeColumns);

  /// True if the system says something of the variable at that column: its origin then has to stay
  /// where it is.
  bool Knows(Eigen::Index column) const { return column < b.size() && H(column, column) > 0.0; }
};

/// The factor of the motion from frame i to i + 1, for steps from the origins: Jacobians there, and
/// r so that r + J d is the residual at the present estimate.
MotionResidual::Linear LinearizeMotion(const Window& window, std::size_t i);

/// The same of what is known of the first pose; J_j is by its ξ. Precondition: window.start.
MotionResidual::Linear LinearizeStart(const Window& window);

/// The same of an observation at its mode, weighted for the loss. Precondition: it has a mode.
ObservationResidual::Linear LinearizeObservation(const Window& window,
                                                 const WindowFrame& frame,
                                                 const WindowObservation& observation);

}  // namespace shiftmap
