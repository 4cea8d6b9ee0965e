// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/incremental/window.h"

#include <cmath>

namespace shiftmap {
namespace {

constexpr Eigen::Index kScale = 3;  // Of ranges, in a CalibrationVector.

}  // namespace

MotionResidual::Linear LinearizeMotion(const Window& window, std::size_t i) {
  const WindowFrame& from = window.frames[i];
  const WindowFrame& to = window.frames[i + 1];
  const MotionResidual& motion = *from.motion;
  MotionResidual::Linear linear = motion.At(from.origin,
                                            to.origin,
                                            window.calibration_origin.head<3>(),
                                            window.calibration_origin[kScale]);
  const CalibrationVector calibration_step = window.calibration - window.calibration_origin;
  linear.r = motion
                 .At(from.T_map_vehicle,
                     to.T_map_vehicle,
                     window.calibration.head<3>(),
                     window.calibration[kScale])
                 .r -
             linear.J_i * from.step - linear.J_j * to.step -
             linear.J_calibration * calibration_step.head<4>();
  return linear;
}

MotionResidual::Linear LinearizeStart(const Window& window) {
  const WindowFrame& first = window.frames.front();
  const Eigen::Vector3d none = Eigen::Vector3d::Zero();
  MotionResidual::Linear linear = window.start->At(window.T_map_start, first.origin, none, 0.0);
  linear.r = window.start->At(window.T_map_start, first.T_map_vehicle, none, 0.0).r -
             linear.J_j * first.step;
  return linear;
}

ObservationResidual::Linear LinearizeObservation(const Window& window,
                                                 const WindowFrame& frame,
                                                 const WindowObservation& observation) {
  const ObservationResidual residual(observation.factor);
  const WindowMode& mode = window.modes[static_cast<std::size_t>(observation.mode)];
  const SensorBias bias_step = (window.calibration - window.calibration_origin).tail<3>();
  ObservationResidual::Linear linear =
      residual.At(frame.origin, mode.origin, window.calibration_origin.tail<3>());
  const Eigen::Vector2d r =
      residual.At(frame.T_map_vehicle, mode.p_map_landmark, window.calibration.tail<3>()).r;
  linear.r = r - linear.J_pose * frame.step -
             linear.J_landmark * (mode.p_map_landmark - mode.origin) - linear.J_bias * bias_step;
  const double weight =
      1.0 / std::sqrt(1.0 + r.squaredNorm() / (window.loss_scale * window.loss_scale));
  return {weight * linear.r,
          weight * linear.J_pose,
          weight * linear.J_landmark,
          weight * linear.J_bias};
}

}  // namespace shiftmap
