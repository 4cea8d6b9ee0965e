// SPDX-License-Identifier: Apache-2.0
#include "mapper/run_maps/variance_factor.h"

#include <gtest/gtest.h>

#include <cmath>

#include "mapper/run_maps/run_map.h"
#include "mapper/run_maps/single_run.h"
#include "tests/unit/mapper/mapper_test_util.h"

namespace shiftmap {
namespace {

double FactorOf(const SimulatedWorld& world, const Run& run) {
  const MapperOptions options;
  const MappingRun arranged = testing::Arrange(world, run);
  const RunMap run_map =
      MakeRunMap(options, MapSingleRun(arranged, world.groups.size(), options)).value();
  return VarianceFactor(options, run_map.build);
}

TEST(VarianceFactor, IsAboutOneForErrorsThatAreAsAssumed) {
  double mean = 0.0;
  constexpr int kRuns = 6;
  for (int seed = 1; seed <= kRuns; ++seed) {
    const SimulatedWorld world = testing::StaticWorld(static_cast<std::uint64_t>(seed));
    mean += FactorOf(world, world.runs[0].run) / kRuns;
  }
  EXPECT_GE(mean, 1.0);
  EXPECT_LT(mean, 2.0);
}

// Ranges that are wrong alike for half a minute do not average as independent ones do.
TEST(VarianceFactor, GrowsWithErrorsThatLast) {
  constexpr double kBias = 0.1;    // [m]
  constexpr double kLasts = 30.0;  // [s]
  const SimulatedWorld world = testing::StaticWorld(1);
  auto run = world.runs[0].run;
  for (Scan& scan : run.scans) {
    const double at_s = ToSeconds(scan.stamp - run.scans.front().stamp);
    for (Observation& observation : scan.observations) {
      observation.z[0] += kBias * (std::fmod(at_s, 2.0 * kLasts) < kLasts ? 1.0 : -1.0);
    }
  }
  EXPECT_GT(FactorOf(world, run), 1.5 * FactorOf(world, world.runs[0].run));
}

}  // namespace
}  // namespace shiftmap
