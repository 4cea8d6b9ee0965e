// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/path_driver.h"

#include <algorithm>
#include <cmath>

#include "tools/sim/tunnels.h"

namespace shiftmap {
namespace {

// To the point that is steered at; larger is smoother. [m]
constexpr double kLookAheadM = 5.0;

// The end of a leg is reached this close to it.
constexpr double kArrivalM = 0.3;

// So slow the loader creeps up to the end, and stands for the driver.
constexpr double kCreepMps = 0.1;
constexpr double kStandingMps = 1e-6;

// The point of the path nearest to the vehicle is looked for this far ahead, in steps.
constexpr double kSearchM = 2.0;
constexpr double kSearchStepM = 0.05;

}  // namespace

PathDriver::PathDriver(std::span<const Eigen::Vector2d> path,
                       const PathDriverOptions& options,
                       const LoaderOptions& loader)
    : path_(path.begin(), path.end()),
      options_(options),
      loader_(loader),
      length_m_(LengthOf(path)) {
  if (options.from_end) std::reverse(path_.begin(), path_.end());
}

Se2 PathDriver::Start() const {
  const Eigen::Vector2d ahead = path_[1] - path_[0];
  return Se2(path_[0], std::atan2(ahead.y(), ahead.x()));
}

// To the nearest point of the path ahead. Returns what is left of the leg. [m]
double PathDriver::Advance(const Eigen::Vector2d& p_map_vehicle) {
  const double sign = leg_ % 2 == 0 ? 1.0 : -1.0;
  const double from = progress_m_;
  double nearest = (PointAlong(path_, from) - p_map_vehicle).norm();
  for (double step = kSearchStepM; step <= kSearchM; step += kSearchStepM) {
    const double at = std::clamp(from + sign * step, 0.0, length_m_);
    const double distance = (PointAlong(path_, at) - p_map_vehicle).norm();
    if (distance >= nearest) continue;
    nearest = distance;
    progress_m_ = at;
  }
  return sign > 0.0 ? length_m_ - progress_m_ : progress_m_;
}

std::optional<LoaderCommand> PathDriver::Drive(const Se2& T_map_vehicle, double v_mps) {
  double left = Advance(T_map_vehicle.translation());
  if (left < kArrivalM) {
    if (std::abs(v_mps) > kStandingMps) return LoaderCommand{0.0, 0.0};
    if (++leg_ >= options_.legs) return std::nullopt;
    left = length_m_ - left;
  }
  const double sign = leg_ % 2 == 0 ? 1.0 : -1.0;
  // Past an end of the path the point that is steered at lies on its extension.
  const double at = progress_m_ + sign * kLookAheadM;
  const double inside = std::clamp(at, 0.0, length_m_);
  const std::size_t last = path_.size() - 1;
  const Eigen::Vector2d ahead = sign > 0.0 ? path_[last] - path_[last - 1] : path_[0] - path_[1];
  const Eigen::Vector2d goal =
      PointAlong(path_, inside) + std::abs(at - inside) * ahead.normalized();
  const Eigen::Vector2d q = T_map_vehicle.Inverse() * goal;
  const double curvature = 2.0 * q.y() / q.squaredNorm();
  const double braking = std::sqrt(2.0 * 0.8 * loader_.acceleration_mps2 * left);
  const double speed = std::min(options_.speed_mps, std::max(kCreepMps, braking));
  return LoaderCommand{sign * speed, Loader::ArticulationFor(loader_, curvature)};
}

}  // namespace shiftmap
