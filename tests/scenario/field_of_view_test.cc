// SPDX-License-Identifier: Apache-2.0
//
// Vehicles that see less far, or less wide, than those that made the map: where such a vehicle sees
// nothing a landmark may stand, and where it sees others it may not.
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "mapstore/codec/run_log.h"
#include "tests/scenario/command.h"
#include "tests/scenario/world.h"
#include "tests/support/status_matchers.h"

namespace shiftmap::testing {
namespace {

struct View {
  std::string option;
  std::string value;
};

// A site on which nothing moves, with the logs of a vehicle like those that made the map and of one
// with a smaller field of view.
class FieldOfViewTest : public ::testing::TestWithParam<View> {
 protected:
  static constexpr int kSites = 4;

  static Arguments Site(int seed) {
    return {"--seed",
            std::to_string(seed),
            "--shifts",
            "4",
            "--vehicles",
            "1",
            "--mode-change-probability",
            "0",
            "--size-m",
            "28",
            "--duration-s",
            "200"};
  }

  static World Smaller(int seed) {
    Arguments options = Site(seed);
    options.insert(options.end(), {GetParam().option, GetParam().value});
    return World(options);
  }

  static void Return(const World& world, const std::string& log) {
    RunForJson("shiftmap-localizer",
               {"run",
                "--store",
                world.File("map.db"),
                "--area",
                "floor",
                "--vehicle",
                "small",
                "--return",
                log});
  }

  // p(absent) by landmark, after the last shift.
  static std::map<std::string, double> Absent(const World& world) {
    std::map<std::string, double> absent;
    const Json shown = RunForJson("shiftmap-inspect",
                                  {"show",
                                   "--store",
                                   world.File("map.db"),
                                   "--area",
                                   "floor",
                                   "--at",
                                   "2026-01-08T08:05Z",
                                   "--json"});
    for (const Json& group : shown.at("groups")) {
      double& probability = absent[group.at("signature")];
      for (const Json& mode : group.at("modes")) {
        if (mode.at("mode") == 0) probability = mode.at("probability");
      }
    }
    return absent;
  }

  static void ExpectNoneAbsent(const World& world) {
    const std::map<std::string, double> absent = Absent(world);
    EXPECT_GE(absent.size(), 18u);
    for (const auto& [signature, probability] : absent) EXPECT_LT(probability, 0.5) << signature;
  }
};

TEST_P(FieldOfViewTest, WhatAVehicleCannotSeeIsNotAbsent) {
  for (int seed = 1; seed <= kSites; ++seed) {
    SCOPED_TRACE(seed);
    const World world(Site(seed));
    const World smaller = Smaller(seed);
    RunForJson("shiftmap-mapper", world.BuildOf("map.db", {0, 1, 2}));
    Return(world, smaller.Log(3));
    ExpectNoneAbsent(world);
  }
}

// In one build, before the others and after them.
TEST_P(FieldOfViewTest, NorIsItInABuildOfBothVehicles) {
  for (int seed = 1; seed <= kSites; ++seed) {
    SCOPED_TRACE(seed);
    const World smaller = Smaller(seed);
    for (const int of_smaller : {0, 3}) {
      const World world(Site(seed));
      std::vector<int> others = {0, 1, 2, 3};
      std::erase(others, of_smaller);
      Arguments build = world.BuildOf("map.db", others);
      build.push_back(smaller.Log(of_smaller));
      RunForJson("shiftmap-mapper", build);
      ExpectNoneAbsent(world);
    }
  }
}

TEST_P(FieldOfViewTest, WhatItPassesCloseByIsAbsentWhenItIsGone) {
  int found = 0;
  for (int seed = 1; seed <= kSites; ++seed) {
    SCOPED_TRACE(seed);
    const World world(Site(seed));
    const World smaller = Smaller(seed);
    RunForJson("shiftmap-mapper", world.BuildOf("map.db", {0, 1, 2}));
    auto log = ReadRunLog(smaller.Log(3));
    ASSERT_THAT(log, IsOk());
    std::map<Signature, int> sightings;
    for (const Scan& scan : log->run.scans) {
      for (const Observation& seen : scan.observations) ++sightings[seen.signature];
    }
    const auto most = std::max_element(
        sightings.begin(), sightings.end(), [](auto& a, auto& b) { return a.second < b.second; });
    const Signature gone = most->first;
    for (Scan& scan : log->run.scans) {
      std::erase_if(scan.observations, [&](const auto& seen) { return seen.signature == gone; });
    }
    const std::string without = world.File("without.mcap");
    ASSERT_THAT(WriteRunLog(log->run, without), IsOk());
    Return(world, without);
    for (const auto& [signature, probability] : Absent(world)) {
      if (signature == gone.text()) {
        found += probability > 0.9;
      } else {
        EXPECT_LT(probability, 0.5) << signature;
      }
    }
  }
  EXPECT_EQ(found, kSites);
}

INSTANTIATE_TEST_SUITE_P(Vehicles,
                         FieldOfViewTest,
                         ::testing::Values(View{"--max-range-m", "4"},
                                           View{"--max-bearing-rad", "0.3"}),
                         [](const auto& vehicle) {
                           return std::string(vehicle.param.option == "--max-range-m" ? "short"
                                                                                      : "narrow");
                         });

}  // namespace
}  // namespace shiftmap::testing
