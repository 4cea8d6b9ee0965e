// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/incremental/mode_window.h"

#include <cmath>
#include <optional>

#include "localizer/models/detection_model.h"
#include "localizer/models/observation_model.h"
#include "mapper/graph/sensor_bias.h"
#include "mapstore/geometry/covariance.h"
#include "tools/experiment/incremental/observation_sequence.h"

namespace shiftmap {
namespace {

// A mode that is in view with less probability than this is not looked for, and what is seen of it
// is taken to have been in view as much.
constexpr double kMinFieldOfView = 0.05;

// A landmark this many standard deviations outside the field of view is not in it.
constexpr double kFarOutside = 4.0;

// P_FOV of a mode from a pose, IJRR 7.2.
double FieldOfView(const Se2& T_map_vehicle,
                   const Eigen::Vector2d& p_map_landmark,
                   const SensorCalibration& sensor) {
  const Eigen::Vector2d q = T_map_vehicle.Inverse() * p_map_landmark;
  const double range_m = q.norm();
  if (range_m > sensor.max_range_m + kFarOutside * sensor.sd_range_m) return 0.0;
  const double bearing_rad = std::atan2(q.y(), q.x());
  if (std::abs(bearing_rad) > sensor.max_bearing_rad + kFarOutside * sensor.sd_bearing_rad) {
    return 0.0;
  }
  const Eigen::Vector2d variance(sensor.sd_range_m * sensor.sd_range_m,
                                 sensor.sd_bearing_rad * sensor.sd_bearing_rad);
  return SectorFieldOfView({range_m, bearing_rad}, variance.asDiagonal(), SectorOf(sensor));
}

// What an observation says of each mode: log p(z | x, m).
Eigen::VectorXd LogDensity(const Window& window,
                           const WindowFrame& frame,
                           const GraphObservation& factor,
                           const std::vector<int>& modes) {
  Eigen::VectorXd log_density(std::ssize(modes));
  for (std::size_t k = 0; k < modes.size(); ++k) {
    const WindowMode& mode = window.modes[static_cast<std::size_t>(modes[k])];
    const Innovation innovation = LinearizeBiased(factor.observation,
                                                  frame.T_map_vehicle,
                                                  mode.p_map_landmark,
                                                  window.calibration.tail<3>(),
                                                  factor.mean_squared_bearing);
    log_density[static_cast<Eigen::Index>(k)] = LogGaussian(innovation.nu, factor.cov_z);
  }
  return log_density;
}

// Index of the frame's observation of a group, if there is one.
std::optional<int> ObservationOf(const WindowFrame& frame, int group_index) {
  for (std::size_t i = 0; i < frame.observations.size(); ++i) {
    if (frame.observations[i].group == group_index) return static_cast<int>(i);
  }
  return std::nullopt;
}

// Pr(δ) at the first step.
Eigen::VectorXd Initial(const IncrementalGroup& group, const IncrementalOptions& options) {
  const auto n = std::ssize(group.modes);
  const bool weights = options.selector.kind == SelectorKind::kMaxMixture;
  if (weights || n == 1 || group.choice_before == kNoMode) {
    return Eigen::VectorXd::Constant(n, 1.0 / static_cast<double>(n));
  }
  const double change = options.change_probability;
  Eigen::VectorXd initial = Eigen::VectorXd::Constant(n, change / static_cast<double>(n - 1));
  initial[group.choice_before] = 1.0 - change;
  return initial;
}

}  // namespace

ModeWindow MakeModeWindow(const Window& window,
                          int group_index,
                          const IncrementalGroup& group,
                          const IncrementalOptions& options) {
  ModeWindow result;
  std::vector<ObservationStep> steps;
  const double detection = options.sensor.detection_probability;
  for (std::size_t f = 0; f < window.frames.size(); ++f) {
    const WindowFrame& frame = window.frames[f];
    const std::optional<int> seen = ObservationOf(frame, group_index);
    const WindowObservation* observation =
        seen ? &frame.observations[static_cast<std::size_t>(*seen)] : nullptr;
    if (observation != nullptr && observation->mode == kNoMode) continue;
    Eigen::VectorXd in_view(std::ssize(group.modes));
    for (std::size_t k = 0; k < group.modes.size(); ++k) {
      const WindowMode& mode = window.modes[static_cast<std::size_t>(group.modes[k])];
      in_view[static_cast<Eigen::Index>(k)] =
          FieldOfView(frame.T_map_vehicle, mode.p_map_landmark, options.sensor);
    }
    if (observation != nullptr) {
      steps.push_back({detection * in_view.cwiseMax(kMinFieldOfView),
                       LogDensity(window, frame, observation->factor, group.modes)});
      result.sightings.push_back({static_cast<int>(f), *seen});
    } else if (in_view.maxCoeff() >= kMinFieldOfView) {
      steps.push_back({detection * in_view, std::nullopt});
      result.sightings.push_back({});
    }
  }
  result.problem =
      MakeObservationSequence(Initial(group, options), options.change_probability, steps);
  return result;
}

}  // namespace shiftmap
