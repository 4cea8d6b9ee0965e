// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "tools/sim/open_world.h"

namespace shiftmap::testing {

/// Two minutes among landmarks, whose log is right.
/// @param noise_v  Of odometry; 0: as by default.
inline Run SimulatedDrive(std::uint64_t seed, double noise_v = 0.0) {
  OpenWorldOptions options;
  options.seed = seed;
  options.runs = 1;
  options.duration_s = 120.0;
  options.size_m = 25.0;
  options.clutter_per_scan = 0.1;
  if (noise_v > 0.0) options.odometry.noise_v = noise_v;
  return SimulateOpen(options).value().runs.front().run;
}

/// Gives a check the items of a run that it looks at.
template <typename Check>
void AddAll(const Run& run, Check* check) {
  ForEachEvent(run, [&](const RunEvent& event) {
    if (const auto* sample = std::get_if<OdometrySample>(&event)) check->Add(*sample);
    if (const auto* scan = std::get_if<Scan>(&event)) check->Add(*scan);
    return OkStatus();
  }).IgnoreError();
}

}  // namespace shiftmap::testing
