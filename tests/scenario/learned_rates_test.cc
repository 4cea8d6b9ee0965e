// SPDX-License-Identifier: Apache-2.0
//
// A store whose ledger is full of what shifts returned, and the rates that a build learns from it.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <random>

#include "mapstore/map_store.h"
#include "tests/scenario/command.h"
#include "tests/scenario/world.h"
#include "tests/support/random_map.h"
#include "tools/sim/simulate_chain.h"

namespace shiftmap::testing {
namespace {

constexpr double kDay = 86400.0;
constexpr double kLeaveRate = 0.7 / kDay;
constexpr int kShifts = 240;

class LearnedRatesTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    world_ = new World({"--shifts", "3", "--duration-s", "60", "--groups", "10", "--size-m", "20"});
    const std::string store = world_->File("before.db");
    RunForJson("shiftmap-mapper", {"build", "--store", store, "--area", "floor", world_->Log(0)});
    ReturnShifts(store);
  }
  static void TearDownTestSuite() {
    delete world_;
    world_ = nullptr;
  }

  // Sixty days before the map with a shift every six hours, which came in only afterwards.
  static void ReturnShifts(const std::string& path) {
    std::mt19937_64 random(TestSeed(81));
    StatusOr<MapStore> store = MapStore::Open(path, MapStore::Access::kReadWrite);
    ASSERT_TRUE(store.ok()) << Message(store.status());
    const StatusOr<MapSnapshot> map = store->LoadAt("floor");
    ASSERT_TRUE(map.ok()) << Message(map.status());
    std::vector<Stamp> stamps;
    for (int i = kShifts; i > 0; --i) {
      stamps.push_back(map->content().stamp - FromSeconds(0.25 * kDay * i));
    }
    std::vector<ChainHistory> histories;
    for (const LandmarkGroup& group : map->groups()) {
      const ModeChain truth = ModeChain::Uniform(static_cast<int>(group.modes.size()), kLeaveRate);
      const ChainPath path_of_group =
          SimulateChain(truth, 1, stamps.front(), stamps.back(), random);
      histories.push_back(ObservePath(path_of_group, truth.states(), stamps, 0.01, random));
    }
    for (std::size_t i = 0; i < stamps.size(); ++i) {
      ShiftReport report;
      report.uuid = fmt::format("00000000-0000-4000-8000-{:012}", i);
      report.vehicle = "truck";
      report.software = "test";
      report.area = "floor";
      report.version = VersionNumber(1);
      report.content_hash = map->content_hash();
      report.run_hash = fmt::format("{:064x}", i + 1);  // Of logs, localized on the map later.
      report.begin = stamps[i];
      report.end = stamps[i];
      for (std::size_t g = 0; g < histories.size(); ++g) {
        const LandmarkGroup& group = map->groups()[g];
        VisitEvidence evidence{group.signature, stamps[i], stamps[i], {}, 1};
        for (int state = 0; state < histories[g].states; ++state) {
          evidence.modes.push_back(
              {group.NumberOf(state), histories[g].visits[i].log_likelihoods[state]});
        }
        report.evidence.push_back(evidence);
      }
      const StatusOr<ReturnResult> returned = store->Return(report);
      ASSERT_TRUE(returned.ok()) << Message(returned.status());
    }
  }

  LearnedRatesTest() : store_(folder_.File("maps.db")) {
    std::filesystem::copy_file(world_->File("before.db"), store_);
  }

  Json Build(const Arguments& words) const {
    Arguments all = {"build", "--store", store_, "--area", "floor"};
    all.insert(all.end(), words.begin(), words.end());
    return RunForJson("shiftmap-mapper", all);
  }

  Json Show() const {
    return RunForJson("shiftmap-inspect", {"show", "--store", store_, "--area", "floor"});
  }

  static World* world_;
  TempDir folder_;
  std::string store_;
};

World* LearnedRatesTest::world_ = nullptr;

TEST_F(LearnedRatesTest, AreNearTheTruth) {
  const Json before = Show();
  const Json chains = Build({world_->Log(1)})["chains"];
  ASSERT_GE(chains.size(), before["groups"].size());
  int held = 0;
  int learned = 0;
  double mean_log = 0.0;
  for (const Json& chain : chains) {
    if (chain["visits"].get<int>() < kShifts) continue;
    EXPECT_TRUE(chain["learned"].get<bool>());
    ++learned;
    mean_log += std::log(chain["leave_rate_per_s"].get<double>() / kLeaveRate);
    held += chain["interval_per_s"][0].get<double>() < kLeaveRate &&
            kLeaveRate < chain["interval_per_s"][1].get<double>();
    // An interval that holds everything would prove nothing.
    EXPECT_LT(chain["interval_per_s"][1].get<double>(),
              4.0 * chain["interval_per_s"][0].get<double>());
  }
  EXPECT_EQ(learned, static_cast<int>(before["groups"].size()));
  EXPECT_GE(held, learned - 2);
  EXPECT_NEAR(mean_log / learned, 0.0, 0.25);

  // And they are the map's.
  const Json groups = Show()["groups"];
  ASSERT_EQ(groups.size(), chains.size());
  for (std::size_t i = 0; i < groups.size(); ++i) {
    EXPECT_EQ(groups[i]["signature"], chains[i]["signature"]);
    EXPECT_EQ(groups[i]["leave_rate_per_s"], chains[i]["leave_rate_per_s"]);
  }
}

TEST_F(LearnedRatesTest, StayAsTheyWereIfAskedTo) {
  const Json before = Show()["groups"];
  const Json result = Build({"--no-learned-rates", world_->Log(1)});
  EXPECT_TRUE(result["chains"].empty());
  const Json groups = Show()["groups"];
  for (const Json& old : before) {
    for (const Json& group : groups) {
      if (group["signature"] != old["signature"]) continue;
      EXPECT_EQ(group["leave_rate_per_s"], old["leave_rate_per_s"]);
    }
  }
}

TEST_F(LearnedRatesTest, DoNotDependOnTheOrderOfRuns) {
  const Json one = Build({"--dry-run", world_->Log(1), world_->Log(2)});
  const Json other = Build({"--dry-run", world_->Log(2), world_->Log(1)});
  EXPECT_EQ(one["chains"], other["chains"]);
  EXPECT_EQ(one["content_hash"], other["content_hash"]);
}

// The build sees the run itself: a report about it adds nothing.
TEST_F(LearnedRatesTest, CountARunOnce) {
  const Json expected = Build({"--dry-run", world_->Log(1)})["chains"];
  RunForJson("shiftmap-localizer",
             {"run", "--store", store_, "--area", "floor", "--return", world_->Log(1)});
  EXPECT_EQ(Build({"--dry-run", world_->Log(1)})["chains"], expected);
}

}  // namespace
}  // namespace shiftmap::testing
