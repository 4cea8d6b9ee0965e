// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/open_world.h"

#include <algorithm>
#include <cmath>
#include <random>
#include <utility>

#include "mapstore/geometry/angle.h"
#include "tools/sim/waypoint_driver.h"

namespace shiftmap {
namespace {

using Random = std::mt19937_64;

// Streams of random numbers that do not depend on how much another one drew.
Random MakeRandom(std::uint64_t seed, int stream) {
  std::seed_seq sequence{static_cast<std::uint32_t>(seed),
                         static_cast<std::uint32_t>(seed >> 32),
                         static_cast<std::uint32_t>(stream)};
  return Random(sequence);
}

double Uniform(double low, double high, Random* random) {
  return std::uniform_real_distribution<double>(low, high)(*random);
}

double Gaussian(double sd, Random* random) {
  return sd * std::normal_distribution<double>()(*random);
}

bool Happens(double probability, Random* random) { return Uniform(0.0, 1.0, random) < probability; }

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

// Where each landmark stands in each run.
std::vector<std::vector<ModeNumber>> DrawStates(const OpenWorldOptions& options, Random* random) {
  const int n = options.modes_per_group;
  std::vector<std::vector<int>> modes(1,
                                      std::vector<int>(static_cast<std::size_t>(options.groups)));
  for (int& mode : modes[0]) mode = std::uniform_int_distribution<int>(1, n)(*random);
  while (std::ssize(modes) < options.runs) {
    std::vector<int>& next = modes.emplace_back(modes.back());
    if (n == 1) continue;
    for (int& mode : next) {
      if (!Happens(options.mode_change_probability, random)) continue;
      const int step = std::uniform_int_distribution<int>(1, n - 1)(*random);
      mode = (mode - 1 + step) % n + 1;
    }
  }
  std::vector<std::vector<ModeNumber>> states;
  for (const std::vector<int>& of_run : modes) {
    std::vector<ModeNumber>& run = states.emplace_back();
    for (const int mode : of_run) {
      run.push_back(Happens(options.absent_probability, random) ? kAbsent : ModeNumber(mode));
    }
  }
  return states;
}

Observation Observe(const Signature& signature,
                    double range,
                    double bearing,
                    const SensorCalibration& sensor,
                    Random* random) {
  constexpr double kMinRange = 0.01;
  Observation observation;
  observation.signature = signature;
  observation.z.x() = std::max(kMinRange, range + Gaussian(sensor.sd_range_m, random));
  observation.z.y() = WrapAngle(bearing + Gaussian(sensor.sd_bearing_rad, random));
  return observation;
}

Scan TakeScan(const OpenWorldOptions& options,
              const std::vector<SimulatedGroup>& groups,
              const std::vector<ModeNumber>& active_mode,
              const StampedPose& pose,
              Random* random) {
  const SensorCalibration& sensor = options.sensor;
  Scan scan{pose.stamp, {}};
  const Se2 T_vehicle_map = pose.T_map_vehicle.Inverse();
  for (std::size_t g = 0; g < groups.size(); ++g) {
    if (active_mode[g] == kAbsent) continue;
    const auto state = static_cast<std::size_t>(active_mode[g].value());
    const Eigen::Vector2d q = T_vehicle_map * groups[g].modes[state - 1];
    if (q.norm() >= sensor.max_range_m) continue;
    const double bearing = std::atan2(q.y(), q.x());
    if (std::abs(bearing) >= sensor.max_bearing_rad) continue;
    if (!Happens(sensor.detection_probability, random)) continue;
    scan.observations.push_back(Observe(groups[g].signature, q.norm(), bearing, sensor, random));
  }
  if (options.clutter_per_scan > 0.0) {
    const int clutter = std::poisson_distribution<int>(options.clutter_per_scan)(*random);
    for (int i = 0; i < clutter; ++i) {
      const auto g = std::uniform_int_distribution<std::size_t>(0, groups.size() - 1)(*random);
      // The square root makes it uniform over the area of the sector.
      const double range = sensor.max_range_m * std::sqrt(Uniform(0.0, 1.0, random));
      const double bearing = Uniform(-sensor.max_bearing_rad, sensor.max_bearing_rad, random);
      scan.observations.push_back(Observe(groups[g].signature, range, bearing, sensor, random));
    }
  }
  return scan;
}

// The motion of one odometry interval: the arc of the velocity, scaled and disturbed.
Se2 TrueMotion(const Velocity& velocity,
               double seconds,
               const OdometryCalibration& odometry,
               Random* random) {
  const double root = std::sqrt(seconds);
  const double along = Gaussian(odometry.noise_v * root, random);
  const double across = Gaussian(odometry.noise_v * root, random);
  const double turn = Gaussian(odometry.noise_omega * root, random);
  return Se2::Exp({odometry.scale_v * velocity.v_mps * seconds + along,
                   across,
                   odometry.scale_omega * velocity.omega_radps * seconds + turn});
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
      simulated.run.scans.push_back(
          TakeScan(options, groups, simulated.active_mode, simulated.truth.back(), &random));
    }
    const Velocity& lagged = logged[logged.size() - 1 - std::min(lag, logged.size() - 1)];
    T_map_vehicle = T_map_vehicle * TrueMotion(lagged, tick_s, options.odometry, &random);
  }
  return simulated;
}

Status CheckStates(const OpenWorldOptions& options) {
  if (options.states.empty()) return OkStatus();
  if (std::ssize(options.states) != options.runs) {
    return InvalidArgument(
        "world: states of {} runs, expected {}", options.states.size(), options.runs);
  }
  for (const std::vector<ModeNumber>& run : options.states) {
    const bool ok = std::ssize(run) == options.groups &&
                    std::all_of(run.begin(), run.end(), [&](ModeNumber mode) {
                      return mode.value() >= 0 && mode.value() <= options.modes_per_group;
                    });
    if (!ok)
      return InvalidArgument("world: states of a run, expected a place or 0 for each landmark");
  }
  return OkStatus();
}

}  // namespace

Status OpenWorldOptions::Validate() const {
  const auto check = [](bool ok, const char* name, double got, const char* expected) {
    return ok ? OkStatus() : InvalidArgument("world: {} = {}, expected {}", name, got, expected);
  };
  const auto probability = [&](const char* name, double p) {
    return check(p >= 0.0 && p <= 1.0, name, p, "0..1");
  };
  const auto positive = [&](const char* name, double value) {
    return check(std::isfinite(value) && value > 0.0, name, value, "> 0");
  };
  const auto not_negative = [&](const char* name, double value) {
    return check(std::isfinite(value) && value >= 0.0, name, value, ">= 0");
  };
  SHIFTMAP_RETURN_IF_ERROR(positive("groups", groups));
  SHIFTMAP_RETURN_IF_ERROR(positive("modes per group", modes_per_group));
  SHIFTMAP_RETURN_IF_ERROR(positive("size", size_m));
  SHIFTMAP_RETURN_IF_ERROR(not_negative("mode gap", mode_gap_m));
  SHIFTMAP_RETURN_IF_ERROR(positive("runs", runs));
  SHIFTMAP_RETURN_IF_ERROR(positive("vehicles", vehicles));
  SHIFTMAP_RETURN_IF_ERROR(CheckStates(*this));
  SHIFTMAP_RETURN_IF_ERROR(positive("duration", duration_s));
  SHIFTMAP_RETURN_IF_ERROR(positive("shift interval", shift_interval_s));
  SHIFTMAP_RETURN_IF_ERROR(probability("mode change probability", mode_change_probability));
  SHIFTMAP_RETURN_IF_ERROR(probability("absent probability", absent_probability));
  SHIFTMAP_RETURN_IF_ERROR(positive("odometry rate", odometry_rate_hz));
  SHIFTMAP_RETURN_IF_ERROR(positive("scan rate", scan_rate_hz));
  SHIFTMAP_RETURN_IF_ERROR(positive("speed", speed_mps));
  SHIFTMAP_RETURN_IF_ERROR(positive("odometry scale of v", odometry.scale_v));
  SHIFTMAP_RETURN_IF_ERROR(positive("odometry scale of omega", odometry.scale_omega));
  SHIFTMAP_RETURN_IF_ERROR(not_negative("odometry lag", odometry.lag_s));
  SHIFTMAP_RETURN_IF_ERROR(not_negative("odometry noise of v", odometry.noise_v));
  SHIFTMAP_RETURN_IF_ERROR(not_negative("odometry noise of omega", odometry.noise_omega));
  SHIFTMAP_RETURN_IF_ERROR(not_negative("range noise", sensor.sd_range_m));
  SHIFTMAP_RETURN_IF_ERROR(not_negative("bearing noise", sensor.sd_bearing_rad));
  SHIFTMAP_RETURN_IF_ERROR(positive("maximum range", sensor.max_range_m));
  SHIFTMAP_RETURN_IF_ERROR(positive("maximum bearing", sensor.max_bearing_rad));
  SHIFTMAP_RETURN_IF_ERROR(probability("detection probability", sensor.detection_probability));
  return not_negative("clutter per scan", clutter_per_scan);
}

StatusOr<SimulatedWorld> SimulateOpen(const OpenWorldOptions& options) {
  SHIFTMAP_RETURN_IF_ERROR(options.Validate());
  Random random = MakeRandom(options.seed, 0);
  SimulatedWorld world;
  SHIFTMAP_ASSIGN_OR_RETURN(world.groups, PlaceGroups(options, &random));
  const std::vector<std::vector<ModeNumber>> states =
      options.states.empty() ? DrawStates(options, &random) : options.states;
  for (int run = 0; run < options.runs; ++run) {
    world.runs.push_back(
        SimulateRun(options, world.groups, states[static_cast<std::size_t>(run)], run));
  }
  return world;
}

}  // namespace shiftmap
