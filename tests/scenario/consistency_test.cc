// SPDX-License-Identifier: Apache-2.0
//
// Is a pose's error as large as its covariance says, however uncertain the map? A hundred drives
// per point: the sum of the NEES is chi-square with 300 degrees of freedom if so.
#include <gtest/gtest.h>

#include "mapstore/geometry/covariance.h"
#include "tools/experiment/localizer_consistency.h"

namespace shiftmap {
namespace {

constexpr int kRuns = 100;

class Consistency : public ::testing::TestWithParam<double> {};

TEST_P(Consistency, TheErrorIsWhatTheCovarianceSays) {
  ConsistencyScene scene;
  scene.sd_map_m = GetParam();
  const ConsistencyResult result = MeasureConsistency(scene, 1, kRuns, 1);
  EXPECT_GE(kRuns * result.nees, ChiSquareQuantile(0.025, 3 * kRuns)) << result.nees;
  EXPECT_LE(kRuns * result.nees, ChiSquareQuantile(0.975, 3 * kRuns)) << result.nees;
  // What a filter believes that takes map and sensor as exact.
  EXPECT_GT(kRuns * result.nees_exact, ChiSquareQuantile(0.999, 3 * kRuns)) << result.nees_exact;
  EXPECT_LT(result.rmse_m, result.rmse_exact_m);
}

INSTANTIATE_TEST_SUITE_P(Maps, Consistency, ::testing::Values(0.0, 0.1, 0.25, 0.5));

}  // namespace
}  // namespace shiftmap
