// SPDX-License-Identifier: Apache-2.0
//
// Both solvers of the graph make the same map: modes within a millimetre or a fiftieth of their
// standard deviation, the same covariances, the same states. The frame is left out: the first pose,
// which it is at, is known less well than a millimetre. In the process, on simulated sites and,
// where it is there (SHIFTMAP_DATA), on recorded data.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "mapper/mapper.h"
#include "proto/core/check.h"
#include "tests/unit/mapper/mapper_test_util.h"
#include "tools/convert/utias.h"

namespace shiftmap::testing {
namespace {

MapperResult Build(SolverKind solver,
                   std::vector<MapperInput> inputs,
                   const std::optional<MapContent>& prior = std::nullopt) {
  MapperOptions options;
  options.solver_kind = solver;
  StatusOr<MapperResult> result = BuildMap(std::move(inputs), prior, options);
  SHIFTMAP_CHECK(result.ok(), "{}", Message(result.status()));
  return *std::move(result);
}

void ExpectSameMap(const MapperResult& schur, const MapperResult& ceres) {
  constexpr double kSameM = 1e-3;
  constexpr double kSameSd = 0.08;  // Of what is known less well than centimetres.
  const MapContent& a = schur.content;
  const MapContent& b = ceres.content;
  ASSERT_EQ(a.groups.size(), b.groups.size());
  std::vector<PointPair> pairs;
  std::vector<double> bounds;
  for (std::size_t g = 0; g < a.groups.size(); ++g) {
    SCOPED_TRACE(a.groups[g].signature.text());
    ASSERT_EQ(a.groups[g].signature, b.groups[g].signature);
    ASSERT_EQ(a.groups[g].modes.size(), b.groups[g].modes.size());
    EXPECT_LT((a.groups[g].probabilities - b.groups[g].probabilities).cwiseAbs().maxCoeff(), 1e-3);
    for (std::size_t m = 0; m < a.groups[g].modes.size(); ++m) {
      const Mode& one = a.groups[g].modes[m];
      const Mode& other = b.groups[g].modes[m];
      pairs.push_back({one.p_map_landmark, other.p_map_landmark});
      bounds.push_back(std::max(kSameM, kSameSd * std::sqrt(one.cov_p_map_landmark.trace())));
      EXPECT_NEAR(other.cov_p_map_landmark.trace() / one.cov_p_map_landmark.trace(), 1.0, 0.05);
    }
  }
  const Se2 T_a_b = AlignRigid2d(pairs).value();
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    EXPECT_LT((pairs[i].p_a - T_a_b * pairs[i].p_b).norm(), bounds[i]);
  }
  ASSERT_EQ(schur.runs.size(), ceres.runs.size());
  for (std::size_t r = 0; r < schur.runs.size(); ++r) {
    // By the noise that each found, to a part in twenty.
    EXPECT_NEAR(ceres.runs[r].chi2 / schur.runs[r].chi2, 1.0, 0.02);
  }
  EXPECT_EQ(schur.rejected.size(), ceres.rejected.size());
}

// A night without a prior map, and a second one on its map.
void ExpectSameNights(const OpenWorldOptions& site) {
  const SimulatedWorld world = Simulate(site);
  std::vector<MapperInput> first = Inputs(world);
  std::vector<MapperInput> second = {first.back()};
  first.pop_back();
  const MapperResult schur = Build(SolverKind::kSchur, first);
  ExpectSameMap(schur, Build(SolverKind::kCeres, first));
  ExpectSameMap(Build(SolverKind::kSchur, second, schur.content),
                Build(SolverKind::kCeres, second, schur.content));
}

TEST(Solvers, MakeTheSameMapsOfSmallSites) {
  for (const std::uint64_t seed : {1, 2, 3}) {
    SCOPED_TRACE(seed);
    OpenWorldOptions site = SmallWorld(seed);
    site.runs = 4;
    ExpectSameNights(site);
  }
}

// More modes than a dense joint covariance has.
TEST(Solvers, MakeTheSameMapsOfALargeSite) {
  OpenWorldOptions site;
  site.seed = 5;
  site.groups = 320;
  site.modes_per_group = 2;
  site.size_m = 65.0;
  site.runs = 2;
  ExpectSameNights(site);
}

TEST(Solvers, MakeTheSameMapsOfRecordedRuns) {
  const char* data = std::getenv("SHIFTMAP_DATA");
  const std::string folder = fmt::format("{}/utias", data == nullptr ? "" : data);
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << "no data";
  for (const auto& [dataset, robot] : {std::pair(1, 1), std::pair(2, 4), std::pair(3, 3)}) {
    SCOPED_TRACE(fmt::format("data set {}, robot {}", dataset, robot));
    UtiasOptions options;
    options.dataset_dir = fmt::format("{}/MRCLAM_Dataset{}", folder, dataset);
    options.robot = robot;
    options.duration_s = 340.0;
    const MapperInput input{"run", "run", ReadUtias(options).value().run};
    ExpectSameMap(Build(SolverKind::kSchur, {input}), Build(SolverKind::kCeres, {input}));
  }
}

}  // namespace
}  // namespace shiftmap::testing
