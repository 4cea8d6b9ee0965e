// SPDX-License-Identifier: Apache-2.0
//
// Whether the covariance of maps of recorded robots is that of their errors: UTIAS MRCLAM, every
// robot and every order of two. Skipped where the data is absent (SHIFTMAP_DATA).
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <vector>

#include "mapper/mapper.h"
#include "tools/convert/utias.h"
#include "tools/experiment/map_consistency.h"

namespace shiftmap {
namespace {

struct Consistency {
  int maps = 0;
  double nees = 0.0;
  double dof = 0.0;
  double worst = 0.0;  // Largest per degree of freedom.

  void Add(const MapContent& content, const std::map<Signature, Eigen::Vector2d>& places) {
    const MapShapeError error = MeasureMapShape(content, places).value();
    ++maps;
    nees += error.nees;
    dof += error.dof;
    worst = std::max(worst, error.nees / error.dof);
  }
};

// Errors that a run has from its begin to its end show when it is held against another one.
TEST(MapConsistencyTest, TheErrorsOfMapsOfRecordedRobotsAreThoseTheyClaim) {
  const char* data = std::getenv("SHIFTMAP_DATA");
  Consistency of_one;
  Consistency of_two;
  Consistency of_nights;
  for (const int dataset : {1, 3, 6}) {
    UtiasOptions options;
    options.dataset_dir =
        fmt::format("{}/utias/MRCLAM_Dataset{}", data == nullptr ? "" : data, dataset);
    if (!std::filesystem::exists(options.dataset_dir)) GTEST_SKIP() << "no data";
    const auto places = ReadUtiasLandmarks(options.dataset_dir).value();
    std::vector<MapperInput> inputs;
    for (const int robot : {1, 2, 3}) {
      options.robot = robot;
      const std::string name = fmt::format("robot {}", robot);
      inputs.push_back({name, name, ReadUtias(options).value().run});
    }
    for (const MapperInput& first : inputs) {
      const MapContent map = BuildMap({first}, std::nullopt, {}).value().content;
      of_one.Add(map, places);
      for (const MapperInput& second : inputs) {
        if (first.name == second.name) continue;
        of_nights.Add(BuildMap({second}, map, {}).value().content, places);
        if (first.name < second.name) {
          of_two.Add(BuildMap({first, second}, std::nullopt, {}).value().content, places);
        }
      }
    }
  }
  for (const Consistency* of : {&of_one, &of_two, &of_nights}) {
    fmt::print("{} maps: NEES {:.2f}, {:.2f} at most\n", of->maps, of->nees / of->dof, of->worst);
  }
  EXPECT_LT(of_one.nees / of_one.dof, 6.0);
  EXPECT_LT(of_two.nees / of_two.dof, 2.5);
  EXPECT_GT(of_two.nees / of_two.dof, 0.5);
  EXPECT_LT(of_two.worst, 6.0);
  EXPECT_LT(of_nights.nees / of_nights.dof, 3.5);
  EXPECT_LT(of_nights.worst, 7.0);
}

}  // namespace
}  // namespace shiftmap
