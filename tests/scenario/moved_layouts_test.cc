// SPDX-License-Identifier: Apache-2.0
//
// One run in each of two layouts, of which three landmarks in one corner are common: UTIAS MRCLAM
// data sets 1 and 2. A build of the two is right, or the second run waits. Skipped where the data
// is absent (SHIFTMAP_DATA).
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "mapper/mapper.h"
#include "mapstore/map/map_snapshot.h"
#include "mapstore/run/trajectory.h"
#include "tools/convert/utias.h"

namespace shiftmap {
namespace {

using Places = std::map<Signature, Eigen::Vector2d>;

constexpr double kRightM = 0.4;

std::string DatasetDir(int dataset) {
  const char* data = std::getenv("SHIFTMAP_DATA");
  return fmt::format("{}/utias/MRCLAM_Dataset{}", data == nullptr ? "" : data, dataset);
}

MapperInput Input(int dataset, int robot) {
  UtiasOptions options;
  options.dataset_dir = DatasetDir(dataset);
  options.robot = robot;
  const std::string name = fmt::format("s{}r{}", dataset, robot);
  return {name, name, ReadUtias(options).value().run};
}

// The largest distance of a mode from the place where its landmark stood in either layout, under
// the best rigid transform of all that were surveyed. [m]
double WorstError(const MapContent& content) {
  const Places layouts[] = {ReadUtiasLandmarks(DatasetDir(1)).value(),
                            ReadUtiasLandmarks(DatasetDir(2)).value()};
  double least = 1e9;
  // The map is near one layout as a whole: from there modes are matched with the nearest place.
  for (const Places& start : layouts) {
    std::vector<AlignmentPoint> reference;
    std::vector<AlignmentPoint> modes;
    for (std::size_t g = 0; g < content.groups.size(); ++g) {
      const LandmarkGroup& group = content.groups[g];
      reference.push_back({GroupIndex(g), start.at(group.signature), Eigen::Matrix2d::Zero()});
      for (const Mode& mode : group.modes) {
        modes.push_back({GroupIndex(g), mode.p_map_landmark, Eigen::Matrix2d::Zero()});
      }
    }
    AlignmentOptions wide;
    wide.position_floor_m = 0.05;
    const auto found = AlignByConsensus(reference, modes, wide);
    if (!found) continue;
    Se2 T_survey_map = found->T_reference_other;
    for (int round = 0; round < 5; ++round) {
      std::vector<PointPair> pairs;
      double worst = 0.0;
      for (const LandmarkGroup& group : content.groups) {
        for (const Mode& mode : group.modes) {
          const Eigen::Vector2d p = T_survey_map * mode.p_map_landmark;
          const Eigen::Vector2d& first = layouts[0].at(group.signature);
          const Eigen::Vector2d& second = layouts[1].at(group.signature);
          pairs.push_back(
              {(first - p).norm() < (second - p).norm() ? first : second, mode.p_map_landmark});
          worst = std::max(worst, (pairs.back().p_a - p).norm());
        }
      }
      least = std::min(least, worst);
      T_survey_map = AlignRigid2d(pairs).value();
    }
  }
  return least;
}

std::string Described(const MapperResult& result) {
  std::string text;
  for (const AmbiguousChange& change : result.ambiguous_changes) {
    text += fmt::format("{} waits:", change.runs.front().name);
    for (const AmbiguousChange::Alternative& explanation : change.explanations) {
      text += " {";
      for (const Signature& signature : explanation.stayed) text += " " + signature.text();
      text += fmt::format(" }} {:.3f}", explanation.probability);
    }
  }
  return text;
}

MapperResult Build(std::vector<MapperInput> inputs, const MapperOptions& options = {}) {
  return BuildMap(std::move(inputs), std::nullopt, options).value();
}

class MovedLayoutsTest : public ::testing::Test {
 protected:
  void SetUp() override {
    for (const int dataset : {1, 2}) {
      if (!std::filesystem::exists(DatasetDir(dataset))) GTEST_SKIP() << "no data";
    }
  }

  static void ExpectRight(const std::string& names, const MapperResult& result) {
    const double worst_m = WorstError(result.content);
    fmt::print("{}: {} in the map, worst mode {:.3f} m {}\n",
               names,
               result.runs.size(),
               worst_m,
               Described(result));
    EXPECT_LT(worst_m, kRightM) << names;
  }

  // Whether both runs are in the map.
  static void ExpectRightOrWaiting(const std::vector<MapperInput>& inputs, bool* decided) {
    std::string names;
    for (const MapperInput& input : inputs) names += input.name + " ";
    const MapperResult result = Build(inputs);
    ExpectRight(names, result);
    EXPECT_EQ(result.runs.size() + result.ambiguous_changes.size(), inputs.size()) << names;
    EXPECT_TRUE(result.rejected.empty()) << names;
    *decided = result.ambiguous_changes.empty();
  }
};

TEST_F(MovedLayoutsTest, OneRunInEachLayoutIsRight) {
  int decided = 0;
  for (const int first : {1, 2, 3}) {
    for (const int second : {1, 2, 4}) {
      bool both = false;
      ExpectRightOrWaiting({Input(1, first), Input(2, second)}, &both);
      decided += both ? 1 : 0;
    }
  }
  EXPECT_EQ(decided, 9);
}

TEST_F(MovedLayoutsTest, ThreeRunsInOneLayoutAndOneInTheOtherAreRight) {
  for (const int second : {1, 2, 4}) {
    bool all = false;
    ExpectRightOrWaiting({Input(1, 1), Input(1, 2), Input(1, 3), Input(2, second)}, &all);
    EXPECT_TRUE(all);
  }
}

// If the distortions of its sensor are left on, and it is placed where most landmarks agree, a run
// of robot 4 is 0.4 to 0.8 m wrong and bent to fit.
TEST_F(MovedLayoutsTest, AWrongPlaceThatIsForcedIsFoundOutByTheFit) {
  MapperOptions options;
  options.confirmation.enabled = false;
  options.distortion_share = 0.0;
  for (const int first : {1, 3}) {
    const MapperResult result = Build({Input(1, first), Input(2, 4)}, options);
    ExpectRight(fmt::format("s1r{} and s2r4", first), result);
    ASSERT_EQ(result.ambiguous_changes.size(), 1U);
    EXPECT_EQ(result.ambiguous_changes.front().runs.front().name, "s2r4");
    ASSERT_TRUE(result.ambiguous_changes.front().misfit);
    EXPECT_GE(result.ambiguous_changes.front().misfit->stayed.size(), 5U);
  }
}

// The second run comes when the first is a published map.
TEST_F(MovedLayoutsTest, ARunOnTheMapOfTheOtherLayoutIsRightOrWaits) {
  const std::map<int, std::vector<int>> robots = {{1, {1, 2, 3}}, {2, {1, 2, 4}}};
  int in_the_map = 0;
  for (const auto& [of_prior, of_run] : {std::pair(1, 2), std::pair(2, 1)}) {
    for (const int first : robots.at(of_prior)) {
      const MapContent prior = Build({Input(of_prior, first)}).content;
      for (const int second : robots.at(of_run)) {
        const std::string names = fmt::format("s{}r{} on s{}r{}", of_run, second, of_prior, first);
        const StatusOr<MapperResult> built =
            BuildMap({Input(of_run, second)}, prior, MapperOptions());
        EXPECT_TRUE(built.ok()) << names << ": " << Message(built.status());
        if (!built.ok()) continue;
        const MapperResult& result = *built;
        ExpectRight(names, result);
        EXPECT_EQ(result.runs.size() + result.ambiguous_changes.size(), 1U) << names;
        if (result.runs.empty()) {
          EXPECT_EQ(ContentHash(result.content), ContentHash(prior)) << names;
        }
        in_the_map += static_cast<int>(result.runs.size());
      }
    }
  }
  EXPECT_GE(in_the_map, 12);
}

// Runs that agree with each other are held against the map as one: what one of them leaves open,
// two together may decide.
TEST_F(MovedLayoutsTest, TwoRunsOfTheOtherLayoutAreRightOrWaitTogether) {
  const std::map<int, std::vector<int>> robots = {{1, {1, 2, 3}}, {2, {1, 2, 4}}};
  int runs_in_the_map = 0;
  for (const auto& [of_prior, of_runs] : {std::pair(1, 2), std::pair(2, 1)}) {
    for (const int first : robots.at(of_prior)) {
      const MapContent prior = Build({Input(of_prior, first)}).content;
      for (const auto& [second, third] : {std::pair(0, 1), std::pair(0, 2), std::pair(1, 2)}) {
        const int a = robots.at(of_runs)[second];
        const int b = robots.at(of_runs)[third];
        const std::string names =
            fmt::format("s{}r{} and r{} on s{}r{}", of_runs, a, b, of_prior, first);
        const MapperResult result =
            BuildMap({Input(of_runs, a), Input(of_runs, b)}, prior, MapperOptions()).value();
        ExpectRight(names, result);
        runs_in_the_map += static_cast<int>(result.runs.size());
      }
    }
  }
  EXPECT_GE(runs_in_the_map, 28);
}

TEST_F(MovedLayoutsTest, TheOrderOfRunsDoesNotMatter) {
  const MapperResult once = Build({Input(1, 1), Input(2, 4)});
  const MapperResult turned = Build({Input(2, 4), Input(1, 1)});
  EXPECT_EQ(ContentHash(once.content), ContentHash(turned.content));
  EXPECT_EQ(Described(once), Described(turned));
}

}  // namespace
}  // namespace shiftmap
