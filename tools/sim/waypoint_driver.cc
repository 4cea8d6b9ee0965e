// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/waypoint_driver.h"

#include <algorithm>
#include <cmath>

#include "mapstore/geometry/angle.h"

namespace shiftmap {
namespace {

constexpr double kTurnRadps = 0.8;  // Top yaw rate. [rad/s]
constexpr double kAccelerationMps2 = 1.0;
constexpr double kTurnAccelerationRadps2 = 2.0;

// Steers at this yaw rate per radian that the waypoint is off. [1/s]
constexpr double kSteeringGain = 1.2;

// Share of the top speed that is kept in the sharpest turn, so that no waypoint is orbited.
constexpr double kSlowest = 0.2;

double Approach(double from, double to, double max_step) {
  return from + std::clamp(to - from, -max_step, max_step);
}

}  // namespace

WaypointDriver::WaypointDriver(const WaypointDriverOptions& options, std::mt19937_64* random)
    : options_(options), random_(random) {}

Eigen::Vector2d WaypointDriver::NextWaypoint(const Eigen::Vector2d& p_map_vehicle) {
  constexpr int kTries = 8;
  std::uniform_real_distribution<double> coordinate(0.0, options_.size_m);
  Eigen::Vector2d p = Eigen::Vector2d::Zero();
  // Far ones make long legs that cover the floor.
  for (int i = 0; i < kTries; ++i) {
    p.x() = coordinate(*random_);
    p.y() = coordinate(*random_);
    if ((p - p_map_vehicle).norm() > 0.3 * options_.size_m) break;
  }
  return p;
}

Se2 WaypointDriver::Start() {
  const Eigen::Vector2d start = Eigen::Vector2d::Constant(0.5 * options_.size_m);
  waypoint_ = NextWaypoint(start);
  velocity_ = {};
  return Se2(start, std::atan2(waypoint_.y() - start.y(), waypoint_.x() - start.x()));
}

Velocity WaypointDriver::Drive(const Se2& T_map_vehicle, double seconds) {
  const double arrival_m = std::max(0.05 * options_.size_m, options_.speed_mps);
  Eigen::Vector2d q = T_map_vehicle.Inverse() * waypoint_;
  if (q.norm() < arrival_m) {
    waypoint_ = NextWaypoint(T_map_vehicle.translation());
    q = T_map_vehicle.Inverse() * waypoint_;
  }
  const double heading = std::atan2(q.y(), q.x());
  const double turn = std::clamp(kSteeringGain * heading, -kTurnRadps, kTurnRadps);
  const double speed = options_.speed_mps * std::max(kSlowest, std::cos(heading));
  velocity_.v_mps = Approach(velocity_.v_mps, speed, kAccelerationMps2 * seconds);
  velocity_.omega_radps = Approach(velocity_.omega_radps, turn, kTurnAccelerationRadps2 * seconds);
  return velocity_;
}

}  // namespace shiftmap
