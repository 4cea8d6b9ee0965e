// SPDX-License-Identifier: Apache-2.0
//
// Scans of 360 beams in a generated mine, and whole drives there and back.
#include <benchmark/benchmark.h>

#include <vector>

#include "tools/sim/mine_world.h"

namespace shiftmap {
namespace {

MineSite Site() { return *MakeMineSite(*GenerateMinePlan({}), {.corners = true}); }

void ScanOfAMine(benchmark::State& state) {
  const MineSite site = Site();
  const RayCaster walls(site.plan.original, 0.1 * static_cast<double>(state.range(0)));
  SimulatedLidar lidar;
  lidar.beams = 360;
  Random random = MakeRandom(1, 0);
  std::vector<double> ranges(360);
  std::size_t count = 0;
  for (auto _ : state) {
    ++count;
    const Se2 pose(site.plan.path[count % site.plan.path.size()], 0.3 * static_cast<double>(count));
    TakeRanges(walls, lidar, pose, &random, ranges);
    benchmark::DoNotOptimize(ranges.data());
  }
  state.SetItemsProcessed(state.iterations());
}
BENCHMARK(ScanOfAMine)->Arg(5)->Arg(10)->Arg(20)->Arg(40)->Unit(benchmark::kMicrosecond);

void DriveThroughAMine(benchmark::State& state) {
  const MineSite site = Site();
  const std::vector<ModeNumber> modes(site.groups.size(), ModeNumber(1));
  MineDriveOptions options;
  if (state.range(0) > 0) options.lidars = FrontAndRearLidar();
  options.points = state.range(0) > 1;
  for (auto _ : state) {
    const auto drive = SimulateDrive(site, PlanVersion::kOriginal, modes, options, 1);
    benchmark::DoNotOptimize(drive->simulated.truth.data());
  }
}
BENCHMARK(DriveThroughAMine)
    ->ArgName("lidars_points")
    ->Arg(0)
    ->Arg(1)
    ->Arg(2)
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace shiftmap
