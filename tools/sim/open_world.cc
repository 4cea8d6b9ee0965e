// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/open_world.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "tools/sim/landmark_sensor.h"
#include "tools/sim/mode_changes.h"
#include "tools/sim/odometry_motion.h"
#include "tools/sim/option_checks.h"
#include "tools/sim/random.h"
#include "tools/sim/waypoint_driver.h"

namespace shiftmap {
namespace {

StatusOr<std::vector<SimulatedGroup>> PlaceGroups(const OpenWorldOptions& options, Random* random) {
  constexpr int kMaxTries = 10000;
  const int digits = static_cast<int>(fmt::formatted_size("{}", options.groups));
  std::vector<Eigen::Vector2d> placed;
  std::vector<SimulatedGroup> groups;
  for (int g = 0; g < options.groups; ++g) {
    SimulatedGroup group{Signature(fmt::format("L{:0{}}", g + 1, digits)), {}};
    for (int tries = 0; std::ssize(group.modes) < options.modes_per_group; ++tries) {
      if (tries == kMaxTries) {
        return InvalidArgument("world: {} places at least {} m apart do not fit on {} m x {} m",
                               options.groups * options.modes_per_group,
                               options.mode_gap_m,
                               options.size_m,
                               options.size_m);
      }
      const double x = Uniform(0.0, options.size_m, random);
      const Eigen::Vector2d p(x, Uniform(0.0, options.size_m, random));
      const bool free = std::all_of(placed.begin(), placed.end(), [&](const Eigen::Vector2d& q) {
        return (p - q).norm() >= options.mode_gap_m;
      });
      if (!free) continue;
      placed.push_back(p);
      group.modes.push_back(p);
    }
    groups.push_back(std::move(group));
  }
  return groups;
}

std::vector<int> ModeCounts(const OpenWorldOptions& options) {
  return std::vector<int>(static_cast<std::size_t>(options.groups), options.modes_per_group);
}

SimulatedRun SimulateRun(const OpenWorldOptions& options,
                         const std::vector<SimulatedGroup>& groups,
                         std::vector<ModeNumber> active_mode,
                         int index) {
  Random random = MakeRandom(options.seed, index + 1);
  SimulatedRun simulated;
  simulated.active_mode = std::move(active_mode);
  simulated.run.info = {fmt::format("vehicle-{}", index % options.vehicles + 1),
                        fmt::format("shiftmap-sim open seed {} run {}", options.seed, index)};
  const double tick_s = 1.0 / options.odometry_rate_hz;
  const auto ticks = static_cast<std::int64_t>(options.duration_s * options.odometry_rate_hz);
  const auto lag = static_cast<std::size_t>(std::lround(options.odometry.lag_s / tick_s));
  const auto scan_every =
      std::max(1LL, std::llround(options.odometry_rate_hz / options.scan_rate_hz));
  const Stamp begin = options.start + FromSeconds(index * options.shift_interval_s);
  WaypointDriver driver({.size_m = options.size_m, .speed_mps = options.speed_mps}, &random);
  std::vector<Velocity> logged;
  Se2 T_map_vehicle = driver.Start();
  for (std::int64_t tick = 0; tick <= ticks; ++tick) {
    const Stamp stamp = begin + FromSeconds(static_cast<double>(tick) * tick_s);
    simulated.truth.push_back({stamp, T_map_vehicle});
    logged.push_back(driver.Drive(T_map_vehicle, tick_s));
    simulated.run.odometry.push_back({stamp, logged.back().v_mps, logged.back().omega_radps});
    if (tick % scan_every == 0) {
      simulated.run.scans.push_back(SenseLandmarks(groups,
                                                   simulated.active_mode,
                                                   simulated.truth.back(),
                                                   options.sensor,
                                                   options.clutter_per_scan,
                                                   {},
                                                   &random));
    }
    const Velocity& lagged = logged[logged.size() - 1 - std::min(lag, logged.size() - 1)];
    T_map_vehicle = T_map_vehicle * TrueMotion(lagged, tick_s, options.odometry, &random);
  }
  return simulated;
}

}  // namespace

Status OpenWorldOptions::Validate() const {
  SHIFTMAP_RETURN_IF_ERROR(CheckPositive("groups", groups));
  SHIFTMAP_RETURN_IF_ERROR(CheckPositive("modes per group", modes_per_group));
  SHIFTMAP_RETURN_IF_ERROR(CheckPositive("size", size_m));
  SHIFTMAP_RETURN_IF_ERROR(CheckNotNegative("mode gap", mode_gap_m));
  SHIFTMAP_RETURN_IF_ERROR(CheckPositive("runs", runs));
  SHIFTMAP_RETURN_IF_ERROR(CheckPositive("vehicles", vehicles));
  if (!states.empty()) SHIFTMAP_RETURN_IF_ERROR(CheckStates(states, ModeCounts(*this), runs));
  SHIFTMAP_RETURN_IF_ERROR(CheckPositive("duration", duration_s));
  SHIFTMAP_RETURN_IF_ERROR(CheckPositive("shift interval", shift_interval_s));
  SHIFTMAP_RETURN_IF_ERROR(CheckProbability("mode change probability", mode_change_probability));
  SHIFTMAP_RETURN_IF_ERROR(CheckProbability("absent probability", absent_probability));
  SHIFTMAP_RETURN_IF_ERROR(CheckPositive("odometry rate", odometry_rate_hz));
  SHIFTMAP_RETURN_IF_ERROR(CheckPositive("scan rate", scan_rate_hz));
  SHIFTMAP_RETURN_IF_ERROR(CheckPositive("speed", speed_mps));
  SHIFTMAP_RETURN_IF_ERROR(CheckOdometry(odometry));
  SHIFTMAP_RETURN_IF_ERROR(CheckLandmarkSensor(sensor));
  return CheckNotNegative("clutter per scan", clutter_per_scan);
}

StatusOr<SimulatedWorld> SimulateOpen(const OpenWorldOptions& options) {
  SHIFTMAP_RETURN_IF_ERROR(options.Validate());
  Random random = MakeRandom(options.seed, 0);
  SimulatedWorld world;
  SHIFTMAP_ASSIGN_OR_RETURN(world.groups, PlaceGroups(options, &random));
  const std::vector<std::vector<ModeNumber>> states =
      options.states.empty()
          ? DrawStates(ModeCounts(options),
                       options.runs,
                       {options.mode_change_probability, options.absent_probability},
                       &random)
          : options.states;
  for (int run = 0; run < options.runs; ++run) {
    if (options.stopped && options.stopped()) return MakeStatus(StatusCode::kCancelled, "stopped");
    world.runs.push_back(
        SimulateRun(options, world.groups, states[static_cast<std::size_t>(run)], run));
  }
  return world;
}

}  // namespace shiftmap
