// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/mine_world.h"

#include <algorithm>
#include <utility>

#include "tools/sim/mode_changes.h"
#include "tools/sim/option_checks.h"
#include "tools/sim/random.h"

namespace shiftmap {
namespace {

StatusOr<MinePlan> MakePlan(const MineWorldOptions& options) {
  if (options.drawn) return *options.drawn;
  MinePlanOptions plan = options.plan;
  plan.seed = options.seed;
  return GenerateMinePlan(plan);
}

// Tags hang where vehicles drive.
StatusOr<MineSite> MakeSite(const MineWorldOptions& options) {
  SHIFTMAP_ASSIGN_OR_RETURN(MinePlan plan, MakePlan(options));
  if (!options.drive.path.empty()) plan.path = options.drive.path;
  SHIFTMAP_RETURN_IF_ERROR(CheckPath(plan.path, plan.walls(options.versions.front())));
  MineLandmarkOptions landmarks = options.landmarks;
  landmarks.seed = options.seed;
  return MakeMineSite(std::move(plan), landmarks);
}

StatusOr<SimulatedRun> SimulateRun(const MineWorldOptions& options,
                                   const MineSite& site,
                                   const std::vector<ModeNumber>& active_mode,
                                   int run) {
  MineDriveOptions drive_options = options.drive;
  drive_options.start += FromSeconds(run * options.shift_interval_s);
  const auto version = std::min(static_cast<std::size_t>(run), options.versions.size() - 1);
  SHIFTMAP_ASSIGN_OR_RETURN(SimulatedDrive drive,
                            SimulateDrive(site,
                                          options.versions[version],
                                          active_mode,
                                          drive_options,
                                          MakeRandom(options.seed, run + 1)()));
  drive.simulated.run.info = {fmt::format("vehicle-{}", run % options.vehicles + 1),
                              fmt::format("shiftmap-sim mine seed {} run {}", options.seed, run)};
  return std::move(drive.simulated);
}

}  // namespace

Status MineWorldOptions::Validate() const {
  SHIFTMAP_RETURN_IF_ERROR(plan.Validate());
  SHIFTMAP_RETURN_IF_ERROR(landmarks.Validate());
  SHIFTMAP_RETURN_IF_ERROR(CheckPositive("runs", runs));
  SHIFTMAP_RETURN_IF_ERROR(CheckPositive("vehicles", vehicles));
  SHIFTMAP_RETURN_IF_ERROR(CheckPositive("shift interval", shift_interval_s));
  SHIFTMAP_RETURN_IF_ERROR(CheckProbability("mode change probability", mode_change_probability));
  SHIFTMAP_RETURN_IF_ERROR(CheckProbability("absent probability", absent_probability));
  if (versions.empty()) return InvalidArgument("world: no version of the plan");
  return drive.Validate();
}

StatusOr<MineWorld> SimulateMine(const MineWorldOptions& options) {
  SHIFTMAP_RETURN_IF_ERROR(options.Validate());
  MineWorld mine;
  SHIFTMAP_ASSIGN_OR_RETURN(mine.site, MakeSite(options));
  mine.world.groups = mine.site.groups;
  Random random = MakeRandom(options.seed, 0);
  const std::vector<std::vector<ModeNumber>> states =
      DrawStates(mine.site.ModeCounts(),
                 options.runs,
                 {options.mode_change_probability, options.absent_probability},
                 &random);
  for (int run = 0; run < options.runs; ++run) {
    if (options.stopped && options.stopped()) return MakeStatus(StatusCode::kCancelled, "stopped");
    SHIFTMAP_ASSIGN_OR_RETURN(
        SimulatedRun simulated,
        SimulateRun(options, mine.site, states[static_cast<std::size_t>(run)], run));
    mine.world.runs.push_back(std::move(simulated));
  }
  return mine;
}

}  // namespace shiftmap
