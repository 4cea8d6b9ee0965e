// SPDX-License-Identifier: Apache-2.0
//
// The same runs, in one build or in many, returned before or not: what the map says of its
// landmarks is the same.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tests/scenario/command.h"
#include "tests/scenario/world.h"

namespace shiftmap::testing {
namespace {

constexpr int kNights = 8;

// Between positions of one place in two maps; places are 2 m apart. [m]
constexpr double kSamePlaceM = 0.5;

class OneMemoryTest : public ::testing::TestWithParam<int> {
 protected:
  OneMemoryTest()
      : world_({"--seed",
                std::to_string(GetParam()),
                "--shifts",
                std::to_string(kNights),
                "--duration-s",
                "120",
                "--groups",
                "14",
                "--size-m",
                "22",
                "--mode-change-probability",
                "0.15"}) {}

  void Build(const std::string& store, const std::vector<int>& runs) const {
    RunForJson("shiftmap-mapper", world_.BuildOf(store, runs));
  }

  void RunAndReturn(const std::string& store, int run) const {
    RunForJson(
        "shiftmap-localizer",
        {"run", "--store", world_.File(store), "--area", "floor", "--return", world_.Log(run)});
  }

  // At a time of its own, so that no clock matters.
  Json Groups(const std::string& store) const {
    return RunForJson("shiftmap-inspect",
                      {"show",
                       "--store",
                       world_.File(store),
                       "--area",
                       "floor",
                       "--at",
                       "1769000000",
                       "--json"})["groups"];
  }

  // What one map says against another, worst or mean over the landmarks.
  struct Difference {
    double position_m = 0.0;       // Largest, between modes that both think likely.
    double total_variation = 0.0;  // Mean.
    double log_rate = 0.0;         // Mean of its absolute value.
    double worst_log_rate = 0.0;
    int states = 0;  // Likeliest states that differ where the odds are above 20.
    int landmarks = 0;
  };

  static Difference Between(const Json& a, const Json& b) {
    Difference difference;
    EXPECT_EQ(a.size(), b.size());
    for (std::size_t g = 0; g < std::min(a.size(), b.size()); ++g) {
      EXPECT_EQ(a[g]["signature"], b[g]["signature"]);
      ++difference.landmarks;
      const double log_rate = std::abs(std::log(a[g]["leave_rate_per_s"].get<double>() /
                                                b[g]["leave_rate_per_s"].get<double>()));
      difference.log_rate += log_rate;
      difference.worst_log_rate = std::max(difference.worst_log_rate, log_rate);
      double common = 0.0;
      for (const Json& mode : a[g]["modes"]) {
        for (const Json& other : b[g]["modes"]) {
          const double distance = Distance(mode, other);
          if (distance > kSamePlaceM) continue;
          const double p = mode["probability"];
          const double q = other["probability"];
          common += std::min(p, q);
          if (p > 0.5 && q > 0.5) difference.position_m = std::max(difference.position_m, distance);
        }
      }
      difference.total_variation += 1.0 - common;
      difference.states += Decided(a[g]) && Decided(b[g]) && common < 0.5;
    }
    difference.total_variation /= difference.landmarks;
    difference.log_rate /= difference.landmarks;
    return difference;
  }

  static bool Decided(const Json& group) {
    std::vector<double> probabilities;
    for (const Json& mode : group["modes"]) probabilities.push_back(mode["probability"]);
    std::sort(probabilities.rbegin(), probabilities.rend());
    return probabilities.size() == 1 || probabilities[0] > 20.0 * probabilities[1];
  }

  // Infinite between `absent` and a place.
  static double Distance(const Json& a, const Json& b) {
    const bool away = a["mode"] == 0;
    if (away != (b["mode"] == 0)) return HUGE_VAL;
    if (away) return 0.0;
    return std::hypot(a["x_m"].get<double>() - b["x_m"].get<double>(),
                      a["y_m"].get<double>() - b["y_m"].get<double>());
  }

  // A night of two minutes knows a place to a decimetre, and what it said stays as it was. One
  // landmark may have a mode more in one of the maps, and then other rates.
  void ExpectSame(const std::string& name, const Json& batch, const Json& other) {
    const Difference difference = Between(batch, other);
    EXPECT_EQ(difference.states, 0) << name;
    EXPECT_LT(difference.position_m, 0.20) << name;
    EXPECT_LT(difference.total_variation, 0.02) << name;
    EXPECT_LT(difference.log_rate, std::log(1.15)) << name;
    EXPECT_LT(difference.worst_log_rate, std::log(1.5)) << name;
    RecordProperty(name,
                   fmt::format("{:.3f} m, total variation {:.4f}, rates {:.1f} %, worst {:.1f} %",
                               difference.position_m,
                               difference.total_variation,
                               100.0 * std::expm1(difference.log_rate),
                               100.0 * std::expm1(difference.worst_log_rate)));
  }

  World world_;
};

TEST_P(OneMemoryTest, RunsInOneBuildOrNightByNightSayTheSame) {
  std::vector<int> all;
  for (int night = 0; night < kNights; ++night) all.push_back(night);
  Build("batch.db", all);
  const Json batch = Groups("batch.db");

  for (const int night : all) Build("nightly.db", {night});
  ExpectSame("nightly", batch, Groups("nightly.db"));

  // Every run is returned before it is mapped: the order of a shift and its night.
  Build("returned.db", {0});
  for (int night = 1; night < kNights; ++night) {
    RunAndReturn("returned.db", night);
    Build("returned.db", {night});
  }
  EXPECT_EQ(Groups("returned.db"), Groups("nightly.db"));

  for (int night = 0; night < kNights; night += 2) Build("pairs.db", {night, night + 1});
  ExpectSame("pairs", batch, Groups("pairs.db"));
}

// A run that should not have been mapped: the next build goes on from before it, and ends where a
// store ends that never had it.
TEST_P(OneMemoryTest, AnExcludedRunIsTakenBackByTheNextBuild) {
  for (const int night : {0, 1, 2}) Build("taken_back.db", {night});
  const Json runs = RunForJson("shiftmap-inspect",
                               {"runs",
                                "--store",
                                world_.File("taken_back.db"),
                                "--area",
                                "floor",
                                "--version",
                                "2"})["runs"];
  ASSERT_EQ(runs.size(), 1u);
  RunForJson("shiftmap-inspect",
             {"runs",
              "exclude",
              "--store",
              world_.File("taken_back.db"),
              "--area",
              "floor",
              "--reason",
              "tyre changed on the way",
              runs[0]["sha256"]});
  // Logs of 1 and 2 are given again; 1 is left out, 2 is mapped anew.
  Build("taken_back.db", {1, 2, 3});

  Build("never.db", {0});
  Build("never.db", {2, 3});
  EXPECT_EQ(Groups("taken_back.db"), Groups("never.db"));
}

INSTANTIATE_TEST_SUITE_P(Worlds, OneMemoryTest, ::testing::Values(31, 32, 33));

}  // namespace
}  // namespace shiftmap::testing
