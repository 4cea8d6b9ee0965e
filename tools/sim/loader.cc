// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/loader.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "tools/sim/option_checks.h"

namespace shiftmap {
namespace {

double Approach(double from, double to, double max_step) {
  return from + std::clamp(to - from, -max_step, max_step);
}

}  // namespace

Status LoaderOptions::Validate() const {
  SHIFTMAP_RETURN_IF_ERROR(CheckPositive("front axle to hinge", front_m));
  SHIFTMAP_RETURN_IF_ERROR(CheckPositive("hinge to rear axle", rear_m));
  SHIFTMAP_RETURN_IF_ERROR(CheckPositive("largest articulation", max_articulation_rad));
  SHIFTMAP_RETURN_IF_ERROR(CheckPositive("articulation rate", max_articulation_radps));
  SHIFTMAP_RETURN_IF_ERROR(CheckPositive("acceleration", acceleration_mps2));
  if (max_articulation_rad >= 0.5 * std::numbers::pi) {
    return InvalidArgument("world: largest articulation = {}, expected < π/2",
                           max_articulation_rad);
  }
  return OkStatus();
}

Velocity Loader::Step(const LoaderCommand& command, double seconds) {
  v_mps_ = Approach(v_mps_, command.v_mps, options_.acceleration_mps2 * seconds);
  const double target = std::clamp(
      command.articulation_rad, -options_.max_articulation_rad, options_.max_articulation_rad);
  const double before = articulation_rad_;
  articulation_rad_ = Approach(before, target, options_.max_articulation_radps * seconds);
  const double rate = (articulation_rad_ - before) / seconds;
  return {v_mps_, YawRate(options_, v_mps_, 0.5 * (before + articulation_rad_), rate)};
}

double Loader::YawRate(const LoaderOptions& options,
                       double v_mps,
                       double articulation_rad,
                       double articulation_radps) {
  return (v_mps * std::sin(articulation_rad) + options.rear_m * articulation_radps) /
         (options.front_m * std::cos(articulation_rad) + options.rear_m);
}

// sin γ = κ (l_f cos γ + l_r), with tan φ = κ l_f: sin(γ - φ) = κ l_r cos φ.
double Loader::ArticulationFor(const LoaderOptions& options, double curvature) {
  const double phase = std::atan(curvature * options.front_m);
  const double sine = std::clamp(curvature * options.rear_m * std::cos(phase), -1.0, 1.0);
  return std::clamp(
      phase + std::asin(sine), -options.max_articulation_rad, options.max_articulation_rad);
}

}  // namespace shiftmap
