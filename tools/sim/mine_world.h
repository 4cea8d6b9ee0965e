// SPDX-License-Identifier: Apache-2.0
//
// Shifts of loaders in a mine whose barriers and tags move. Parts of it for experiments:
// GenerateMinePlan() or ReadMineDrawing(), MakeMineSite(), SimulateDrive().
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "mapstore/core/day.h"
#include "proto/core/status.h"
#include "tools/sim/mine_drive.h"
#include "tools/sim/mine_plan.h"
#include "tools/sim/mine_site.h"
#include "tools/sim/simulated_world.h"

namespace shiftmap {

struct MineWorldOptions {
  std::uint64_t seed = 1;  ///< Of everything random. Seeds below are not used.

  std::optional<MinePlan> drawn = {};  ///< A plan that is there already, instead of one by `plan`.
  MinePlanOptions plan;
  MineLandmarkOptions landmarks;

  int runs = 3;
  int vehicles = 2;                          ///< That take turns, a run each. > 0.
  double shift_interval_s = kSecondsPerDay;  ///< From the start of one run to that of the next. [s]

  /// Of the plan, by run; the last holds for the runs that are left. Not empty.
  std::vector<PlanVersion> versions = {PlanVersion::kOriginal};

  double mode_change_probability = 0.25;  ///< As in OpenWorldOptions.
  double absent_probability = 0.0;        ///< As in OpenWorldOptions. A barrier is then open.

  MineDriveOptions drive;  ///< Starts with the first run.

  std::function<bool()> stopped = {};  ///< As in OpenWorldOptions.

  /// Errors: kInvalidArgument naming the first member out of range.
  Status Validate() const;
};

struct MineWorld {
  MineSite site;
  SimulatedWorld world;
};

/// Simulates shifts.
/// Determinism: the same options give the same bits.
/// Errors: as Validate(), GenerateMinePlan(), MakeMineSite() and SimulateDrive(); kCancelled.
StatusOr<MineWorld> SimulateMine(const MineWorldOptions& options);

}  // namespace shiftmap
