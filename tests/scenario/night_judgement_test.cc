// SPDX-License-Identifier: Apache-2.0
//
// What a night judges before vehicles get a map. The oracle of a night with a bad log is the same
// night without it.
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "mapstore/codec/run_log.h"
#include "mapstore/map_store.h"
#include "tests/scenario/background_command.h"
#include "tests/scenario/command.h"
#include "tests/scenario/world.h"
#include "tests/support/status_matchers.h"

namespace shiftmap::testing {
namespace {

namespace fs = std::filesystem;

constexpr int kAttention = 8;
constexpr int kVehicles = 3;

using Change = std::function<void(shiftmap::Run*)>;

// A site and its nights: stores and log folders by name.
class NightJudgementTest : public ::testing::Test {
 protected:
  std::string Store(const std::string& name) const { return world_.File(name + ".db"); }
  std::string Logs(const std::string& name) const { return world_.File(name); }

  void Bring(const std::string& site, int run, const std::string& as, const Change& change = {}) {
    fs::create_directories(Logs(site));
    shiftmap::Run log = ReadRunLog(world_.Log(run))->run;
    log.info.area = "floor";
    log.info.uuid = fmt::format("0f8fad5b-d9cb-469f-a165-{:012x}", run + 1);
    if (change) change(&log);
    ASSERT_THAT(WriteRunLog(log, Logs(site) + "/" + as + ".mcap"), IsOk());
  }

  // The runs of the first day, mapped.
  void FirstNight(const std::string& site) {
    for (int run = 0; run < kVehicles; ++run) Bring(site, run, fmt::format("day0_{}", run));
    ASSERT_EQ(Night(site).exit_code, 0);
  }

  CommandResult Night(const std::string& site, const Arguments& more = {}) const {
    Arguments words = {
        "nightly", "--store", Store(site), "--logs", Logs(site), "--min-age-s", "0", "--json"};
    words.insert(words.end(), more.begin(), more.end());
    return RunCommand("shiftmap-mapper", words);
  }

  // Content hash of what is published.
  std::string Published(const std::string& site, const std::string& area = "floor") const {
    MapStore store = *MapStore::Open(Store(site), MapStore::Access::kReadOnly);
    const auto published = *store.PublishedVersion(area);
    return published ? store.LoadVersion(area, *published)->content_hash() : "nothing";
  }

  std::size_t Versions(const std::string& site) const {
    return MapStore::Open(Store(site), MapStore::Access::kReadOnly)->Versions("floor")->size();
  }

  World world_{{"--seed",
                "5",
                "--shifts",
                "9",
                "--vehicles",
                "3",
                "--duration-s",
                "60",
                "--groups",
                "12",
                "--size-m",
                "20",
                "--shift-interval-s",
                "14400",
                "--mode-change-probability",
                "0.05"}};
};

Change Frozen() {
  return [](shiftmap::Run* run) {
    for (OdometrySample& sample : run->odometry) sample.v_mps = sample.omega_radps = 0.0;
  };
}

// Wheels that spin for two seconds of every six.
Change Slipping() {
  return [](shiftmap::Run* run) {
    for (OdometrySample& sample : run->odometry) {
      const double s = ToSeconds(sample.stamp - run->odometry.front().stamp);
      if (std::fmod(s, 6.0) < 2.0) sample.v_mps *= 3.0;
    }
  };
}

// The clock is half a day behind: the vehicle seems to have been in another run then.
Change HalfADayBehind() {
  return [](shiftmap::Run* run) {
    constexpr std::chrono::hours kBehind(12);
    for (OdometrySample& sample : run->odometry) sample.stamp -= kBehind;
    for (Scan& scan : run->scans) scan.stamp -= kBehind;
  };
}

Change NeverSet() {
  return [](shiftmap::Run* run) {
    const Duration behind = run->odometry.front().stamp.time_since_epoch() - std::chrono::hours(1);
    for (OdometrySample& sample : run->odometry) sample.stamp -= behind;
    for (Scan& scan : run->scans) scan.stamp -= behind;
  };
}

struct Poison {
  const char* name;
  Change (*change)();
};

class PoisonedNightTest : public NightJudgementTest,
                          public ::testing::WithParamInterface<Poison> {};

TEST_P(PoisonedNightTest, LeavesTheMapOfTheNightWithoutTheLog) {
  FirstNight("with");
  FirstNight("without");
  for (const char* const site : {"with", "without"}) {
    Bring(site, 3, "good_3");
    Bring(site, 4, "good_4");
  }
  Bring("with", 5, "poisoned", GetParam().change());
  const CommandResult with = Night("with");
  const CommandResult without = Night("without");
  EXPECT_EQ(without.exit_code, 0) << without.err;
  EXPECT_EQ(with.exit_code, kAttention) << with.err;
  EXPECT_EQ(Published("with"), Published("without"));
  const Json area = Json::parse(with.out)["areas"][0];
  EXPECT_EQ(area["published"], true);
  ASSERT_FALSE(area["reasons"].empty());
  EXPECT_NE(area["reasons"].dump().find("poisoned"), std::string::npos) << area["reasons"];

  // It is named until somebody decides, and no build takes it.
  const CommandResult again = Night("with");
  EXPECT_EQ(again.exit_code, kAttention);
  EXPECT_NE(again.err.find("poisoned"), std::string::npos) << again.err;
  EXPECT_EQ(Published("with"), Published("without"));
  // What it was built with is not stored.
  EXPECT_EQ(Versions("with"), 2u);
}

INSTANTIATE_TEST_SUITE_P(All,
                         PoisonedNightTest,
                         ::testing::Values(Poison{"Frozen", Frozen},
                                           Poison{"Slipping", Slipping},
                                           Poison{"HalfADayBehind", HalfADayBehind},
                                           Poison{"NeverSet", NeverSet}),
                         [](const auto& test) { return std::string(test.param.name); });

// The oracle is the store of the same nights without the logs that are left out.
TEST_F(NightJudgementTest, TheStoreGrowsByOneVersionANightWhateverIsLeftOut) {
  FirstNight("with");
  FirstNight("without");
  std::vector<double> growth;
  for (int night = 1; night <= 6; ++night) {
    for (const char* const site : {"with", "without"}) {
      const auto size = [&] { return static_cast<double>(fs::file_size(Store(site))); };
      const double before = size();
      Bring(site, kVehicles + night - 1, fmt::format("day{}", night));
      if (site == std::string("with")) {
        Bring(
            site, kVehicles + night - 1, fmt::format("poisoned{}", night), [&](shiftmap::Run* run) {
              run->info.uuid[0] = 'f';
              Frozen()(run);
              for (OdometrySample& sample : run->odometry) sample.stamp += std::chrono::hours(1);
              for (Scan& scan : run->scans) scan.stamp += std::chrono::hours(1);
            });
      }
      Night(site, {"--judge-shifts", "2"});
      EXPECT_EQ(Versions(site), static_cast<std::size_t>(night) + 1) << site;
      if (site == std::string("with")) growth.push_back(size() - before);
    }
    EXPECT_EQ(Published("with"), Published("without")) << night;
  }
  const auto size = [&](const char* site) {
    return static_cast<double>(fs::file_size(Store(site)));
  };
  EXPECT_LT(size("with"), 1.1 * size("without"));
  const double first = growth[0] + growth[1] + growth[2];
  const double second = growth[3] + growth[4] + growth[5];
  EXPECT_LT(second, 1.5 * first);
}

// A log without an area goes to the one map that it fits, and that is found out once.
TEST_F(NightJudgementTest, ALogWithoutAnAreaGoesWhereItFits) {
  FirstNight("site");
  const World other(
      {"--seed", "9", "--shifts", "1", "--groups", "12", "--size-m", "20", "--duration-s", "60"});
  shiftmap::Run hall = ReadRunLog(other.Log(0))->run;
  hall.info.area = "hall";
  for (Scan& scan : hall.scans) {
    for (Observation& seen : scan.observations) {
      seen.signature = Signature("H" + seen.signature.text());
    }
  }
  ASSERT_THAT(WriteRunLog(hall, Logs("site") + "/hall.mcap"), IsOk());
  ASSERT_EQ(Night("site").exit_code, 0);
  const auto without_area = [](shiftmap::Run* run) { run->info.area.clear(); };
  Bring("site", 3, "no_area", without_area);
  const auto places = [&] {
    MapStore store = *MapStore::Open(Store("site"), MapStore::Access::kReadOnly);
    std::vector<std::string> subjects;
    const std::vector<AuditEntry> audit = *store.AuditLog();
    for (const AuditEntry& entry : audit) {
      if (entry.action == "locate") subjects.push_back(entry.subject);
    }
    return subjects;
  };
  const CommandResult night = Night("site");
  EXPECT_EQ(night.exit_code, 0) << night.err;
  const Json areas = Json::parse(night.out)["areas"];
  ASSERT_EQ(areas.size(), 2u);
  EXPECT_EQ(areas[0]["area"], "floor");
  EXPECT_EQ(areas[0]["version"], 2);
  EXPECT_EQ(places(), std::vector<std::string>{"0f8fad5b-d9cb-469f-a165-000000000004 2 one floor"});
  Night("site");
  EXPECT_EQ(places().size(), 1u);
}

// The limits take what is mapped, the oldest first, and nothing else.
TEST_F(NightJudgementTest, LimitsDeleteMappedLogsOnly) {
  FirstNight("site");
  Bring("site", 3, "day1_3");
  Bring("site", 4, "unmapped", NeverSet());
  // The night would map the fourth, too.
  const CommandResult planned = Night("site", {"--log-quota-mib", "0", "--dry-run"});
  const Json to_delete = Json::parse(planned.out)["logs_to_delete"];
  ASSERT_EQ(to_delete.size(), 3u) << planned.out;
  EXPECT_EQ(to_delete[0], Logs("site") + "/day0_0.mcap");
  EXPECT_EQ(Json::parse(planned.out)["logs_deleted"], 0);
  EXPECT_EQ(planned.err.find("what is left"), std::string::npos) << planned.err;
  EXPECT_TRUE(fs::exists(Logs("site") + "/day0_0.mcap"));

  const CommandResult night = Night("site", {"--log-quota-mib", "0"});
  EXPECT_EQ(night.exit_code, kAttention);
  EXPECT_EQ(Json::parse(night.out)["logs_deleted"], 4);
  EXPECT_TRUE(fs::exists(Logs("site") + "/unmapped.mcap"));
  EXPECT_FALSE(fs::exists(Logs("site") + "/day0_0.mcap"));
  EXPECT_NE(night.err.find("what is left is in no map and stays"), std::string::npos) << night.err;

  Bring("site", 5, "day1_5");
  fs::last_write_time(Logs("site") + "/day1_5.mcap",
                      fs::file_time_type::clock::now() - std::chrono::hours(50));
  const CommandResult old = Night("site", {"--log-max-age-days", "2"});
  EXPECT_EQ(Json::parse(old.out)["logs_deleted"], 1);
  EXPECT_TRUE(fs::exists(Logs("site") + "/unmapped.mcap"));
}

// What is held out judges this night and is mapped by the next.
TEST_F(NightJudgementTest, AHeldOutRunIsMappedTheNextNight) {
  FirstNight("site");
  for (const int run : {3, 4, 5}) Bring("site", run, fmt::format("day1_{}", run));
  const CommandResult night = Night("site", {"--hold-out", "40"});
  ASSERT_EQ(night.exit_code, 0) << night.err;
  const Json area = Json::parse(night.out)["areas"][0];
  EXPECT_EQ(area["held_out"], 1);
  int judges = 0;
  for (const Json& shift : area["judgement"]["shifts"]) {
    const std::string log = shift["log"];
    judges += log.find("day1_") != std::string::npos && shift["in_build"] == false ? 1 : 0;
  }
  EXPECT_EQ(judges, 1);
  EXPECT_EQ(Json::parse(Night("site", {"--hold-out", "40"}).out)["areas"][0]["version"], 3);
  MapStore store = *MapStore::Open(Store("site"), MapStore::Access::kReadOnly);
  EXPECT_EQ(store.RunIdentities("floor", VersionNumber(3))->size(), 12u);
}

// A night that is killed again and again ends as one that is left alone.
TEST_F(NightJudgementTest, AKilledNightGoesOnWhereItWas) {
  FirstNight("alone");
  FirstNight("killed");
  for (const char* const site : {"alone", "killed"}) {
    Bring(site, 3, "good_3");
    Bring(site, 4, "good_4");
    Bring(site, 5, "poisoned", Slipping());
  }
  ASSERT_EQ(Night("alone").exit_code, kAttention);
  int kills = 0;
  int exit_code = 128 + SIGKILL;
  double wait_us = 20'000.0;
  for (int attempt = 1; exit_code == 128 + SIGKILL && attempt < 60; ++attempt) {
    BackgroundCommand night("shiftmap-mapper",
                            {"nightly",
                             "--store",
                             Store("killed"),
                             "--logs",
                             Logs("killed"),
                             "--min-age-s",
                             "0",
                             "--json"});
    usleep(static_cast<useconds_t>(wait_us * kSlowdown));
    wait_us *= 1.15;
    exit_code = night.End(SIGKILL);
    kills += exit_code == 128 + SIGKILL ? 1 : 0;
  }
  EXPECT_EQ(exit_code, kAttention);
  EXPECT_GT(kills, 3);
  EXPECT_EQ(Published("killed"), Published("alone"));
  const auto published = [&](const std::string& site) {
    return RunForJson(
        "shiftmap-inspect",
        {"show", "--store", Store(site), "--area", "floor", "--at", "1769000000"})["groups"];
  };
  EXPECT_EQ(published("killed"), published("alone"));
}

// Areas on several machines give what one process gives.
class PlannedNightTest : public NightJudgementTest {
 protected:
  void BringDay(const std::string& site, int day) {
    for (int run = 0; run < kVehicles; ++run) {
      for (const std::string area : {"floor", "hall"}) {
        if (area == "hall" && run == 2) continue;
        Bring(site,
              day * kVehicles + run,
              fmt::format("{}_{}_{}", area, day, run),
              [&](shiftmap::Run* log) {
                log->info.area = area;
                if (area == "hall") log->info.uuid[0] = '1';
              });
      }
    }
    Bring(site, day * kVehicles + 2, fmt::format("slip_{}", day), [](shiftmap::Run* log) {
      log->info.area = "hall";
      log->info.uuid[0] = '1';
      Slipping()(log);
    });
  }

  std::string Plan(const std::string& site) const { return world_.File(site + ".json"); }

  CommandResult Phase(const std::string& site, Arguments words) const {
    words.insert(words.begin(), "nightly");
    words.insert(words.end(), {"--plan", Plan(site), "--json"});
    return RunCommand("shiftmap-mapper", words);
  }

  CommandResult MakePlan(const std::string& site) const {
    return Night(site, {"plan", "--output", Plan(site)});
  }
};

TEST_F(PlannedNightTest, GivesTheSameMapsAsOneProcess) {
  for (int day = 0; day < 3; ++day) {
    BringDay("one", day);
    BringDay("many", day);
    Night("one");
    const CommandResult plan = MakePlan("many");
    ASSERT_EQ(plan.exit_code, 0) << plan.err;
    ASSERT_EQ(Json::parse(plan.out)["areas"].size(), 2u);
    for (const char* const index : {"1", "0"}) {
      EXPECT_EQ(Phase("many", {"run", "--index", index}).exit_code, 0);
    }
    CommandResult collect = Phase("many", {"collect"});
    EXPECT_EQ(Json::parse(collect.out)["left"].size(), 0u) << collect.err;
    // Done again it changes nothing.
    MapStore store = *MapStore::Open(Store("many"), MapStore::Access::kReadOnly);
    const std::size_t audit = store.AuditLog()->size();
    Phase("many", {"collect"});
    EXPECT_EQ(store.AuditLog()->size(), audit);
    for (const std::string area : {"floor", "hall"}) {
      EXPECT_EQ(Published("many", area), Published("one", area)) << day << area;
      const auto show = [&](const std::string& site) {
        return RunForJson("shiftmap-inspect",
                          {"show", "--store", Store(site), "--area", area, "--at", "1769000000"});
      };
      EXPECT_EQ(show("many"), show("one"));
      const auto held = [&](const std::string& site) {
        MapStore of = *MapStore::Open(Store(site), MapStore::Access::kReadOnly);
        std::vector<std::string> runs;
        const std::vector<Exclusion> exclusions = *of.Exclusions(area);
        for (const Exclusion& exclusion : exclusions) runs.push_back(exclusion.run);
        return runs;
      };
      EXPECT_EQ(held("many"), held("one"));
    }
  }
  RunForJson("shiftmap-inspect", {"verify", "--store", Store("many")});
}

TEST_F(PlannedNightTest, AnAreaThatChangedSinceThePlanIsNotTaken) {
  BringDay("site", 0);
  Night("site");
  BringDay("site", 1);
  ASSERT_EQ(MakePlan("site").exit_code, 0);
  EXPECT_EQ(Phase("site", {"run", "--index", "0"}).exit_code, 0);
  EXPECT_EQ(Phase("site", {"run", "--index", "7"}).exit_code, 6);
  Night("site", {"--area", "floor"});
  const std::string before = Published("site");
  BringDay("site", 2);
  Night("site", {"--area", "floor"});
  const std::string after = Published("site");
  ASSERT_NE(before, after);
  const CommandResult collect = Phase("site", {"collect"});
  EXPECT_EQ(collect.exit_code, kAttention);
  EXPECT_NE(collect.err.find("since the night was planned"), std::string::npos) << collect.err;
  EXPECT_NE(collect.err.find("no result: run --index 1 again"), std::string::npos) << collect.err;
  EXPECT_EQ(Published("site"), after);
}

// One page that says what happened, whatever names the logs have.
TEST_F(NightJudgementTest, TheReportIsOnePageWithoutScripts) {
  FirstNight("site");
  const std::string hostile = "<script>alert(1)</script>";
  Bring("site", 3, "day1_3", [&](shiftmap::Run* run) { run->info.vehicle = hostile; });
  Bring("site", 4, "day1_4");
  const std::string folder = world_.File("report");
  ASSERT_EQ(Night("site", {"--report", folder}).exit_code, 0);
  std::string html;
  int files = 0;
  for (const auto& entry : fs::directory_iterator(folder)) {
    ++files;
    if (entry.path().extension() != ".html") continue;
    std::ostringstream text;
    text << std::ifstream(entry.path()).rdbuf();
    html = text.str();
  }
  EXPECT_EQ(files, 2);
  EXPECT_EQ(html.find("<script"), std::string::npos);
  EXPECT_NE(html.find("&lt;script&gt;"), std::string::npos);
  EXPECT_EQ(html.find("http:"), std::string::npos);
  std::size_t pictures = 0;
  for (std::size_t at = 0; (at = html.find("data:image/svg+xml;base64,", at)) != std::string::npos;
       ++at) {
    ++pictures;
  }
  EXPECT_EQ(pictures, 3u);
}

}  // namespace
}  // namespace shiftmap::testing
