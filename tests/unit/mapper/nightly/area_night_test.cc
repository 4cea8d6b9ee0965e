// SPDX-License-Identifier: Apache-2.0
//
// Versions that are worse on purpose: the map before with its landmarks moved about.
#include "mapper/nightly/area_night.h"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <algorithm>
#include <chrono>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <random>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "mapper/cli/area_build.h"
#include "mapper/cli/log_file.h"
#include "mapper/nightly/candidate.h"
#include "mapper/nightly/left_out.h"
#include "mapstore/cli/stop_signals.h"
#include "mapstore/codec/run_log.h"
#include "mapstore/core/memory_bound.h"
#include "mapstore/maintenance/verify.h"
#include "mapstore/map_store.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tools/sim/open_world.h"

namespace shiftmap {
namespace {

using testing::IsOk;
using testing::StatusIs;

class AreaNightTest : public ::testing::Test {
 protected:
  AreaNightTest() {
    OpenWorldOptions options;
    options.groups = 12;
    options.size_m = 20.0;
    options.duration_s = 40.0;
    options.runs = 6;
    options.vehicles = 1;
    options.mode_change_probability = 0.0;
    options.shift_interval_s = 3600.0;
    world_ = *SimulateOpen(options);
    night_.build.store = folder_.File("maps.db");
    night_.build.threads = 1;
  }

  LogHead Log(int index) const {
    shiftmap::Run run = world_.runs[static_cast<std::size_t>(index)].run;
    run.info.area = "floor";
    run.info.uuid = fmt::format("0f8fad5b-d9cb-469f-a165-{:012x}", index);
    const std::string path = folder_.File(fmt::format("run_{}.mcap", index));
    EXPECT_THAT(WriteRunLog(run, path), IsOk());
    return *ReadLogHead(path);
  }

  AreaNight Night(const std::vector<LogHead>& fresh, const std::vector<LogHead>& mapped = {}) {
    AreaLogs logs;
    logs.fresh = fresh;
    logs.mapped = mapped;
    std::ostringstream err;
    Context context(CommonOptions(), &err);
    const StopSignals signals;
    StatusOr<AreaNight> night = RunAreaNight(night_, "floor", logs, context);
    EXPECT_THAT(night.status(), IsOk());
    return *std::move(night);
  }

  MapStore Store() const {
    return *MapStore::Open(night_.build.store, MapStore::Access::kReadWrite);
  }

  // What a build of these logs on version 1 would have left, with landmarks off by `sd_m`.
  VersionNumber CommitMoved(const std::vector<LogHead>& logs, double sd_m) {
    MapStore store = Store();
    MapContent content = store.LoadVersion("floor", VersionNumber(1))->content();
    std::mt19937_64 random(7);
    std::normal_distribution<double> noise(0.0, sd_m);
    for (LandmarkGroup& group : content.groups) {
      for (Mode& mode : group.modes) {
        mode.p_map_landmark += Eigen::Vector2d(noise(random), noise(random));
      }
    }
    Provenance provenance;
    provenance.tool = "test";
    provenance.configuration = nlohmann::json{{"night", NightKey(logs, night_.build)}}.dump();
    for (const LogHead& log : logs) {
      provenance.runs.push_back({"run",
                                 std::string(64, 'a'),
                                 log.info.vehicle,
                                 log.begin,
                                 log.begin,
                                 {},
                                 {},
                                 log.info.uuid});
    }
    CommitOptions options;
    options.parent = VersionNumber(1);
    options.publish = false;
    options.states_probabilities = false;
    const auto commit = store.Commit("floor", content, provenance, options);
    EXPECT_THAT(commit.status(), IsOk());
    return commit->version;
  }

  SimulatedWorld world_;
  testing::TempDir folder_;
  NightOptions night_;
};

TEST_F(AreaNightTest, AVersionThatIsWorseIsNotPublishedAndThreeInARowAreAnAlarm) {
  const std::vector<LogHead> mapped = {Log(0), Log(1)};
  ASSERT_TRUE(Night(mapped).published);
  std::vector<LogHead> fresh;
  for (int night = 1; night <= kAlarmRefusals; ++night) {
    fresh.push_back(Log(1 + night));
    const VersionNumber worse = CommitMoved(fresh, 1.0);
    // What the area is built from once more, without the runs of the refused one.
    if (night > 1) CommitMoved({fresh.back()}, 1.0);
    for (const char* const time : {"first", "again"}) {
      const AreaNight result = Night(fresh, mapped);
      EXPECT_EQ(result.version, worse) << time;
      EXPECT_FALSE(result.published);
      EXPECT_EQ(result.refused_in_a_row, night) << time;
      EXPECT_EQ(result.alarm(), night == kAlarmRefusals);
      ASSERT_FALSE(result.reasons.empty());
      EXPECT_NE(result.reasons.back().find("is not published"), std::string::npos)
          << result.reasons.back();
    }
    EXPECT_EQ(*Store().PublishedVersion("floor"), VersionNumber(1));
  }
  // One that is good ends the row.
  fresh.push_back(Log(5));
  const AreaNight good = Night(fresh, mapped);
  EXPECT_TRUE(good.published) << (good.reasons.empty() ? "" : good.reasons.front());
  EXPECT_EQ(good.refused_in_a_row, 0);
}

// What a night judged by: mapped shifts, and those of the build, in the order of time.
std::vector<std::string> Judges(const AreaNight& night, bool in_build) {
  std::vector<std::string> runs;
  for (const JudgedShift& shift : night.judgement->shifts) {
    if (shift.fold == 0 && shift.in_build == in_build) runs.push_back(shift.run);
  }
  std::sort(runs.begin(), runs.end());
  return runs;
}

// One that is an outlier would stop the area for good.
TEST_F(AreaNightTest, AfterARefusalOtherShiftsJudge) {
  night_.judge.max_shifts = 1;
  const std::vector<LogHead> mapped = {Log(0), Log(1), Log(2)};
  ASSERT_TRUE(Night(mapped).published);
  std::vector<LogHead> fresh = {Log(3)};
  CommitMoved(fresh, 1.0);
  const AreaNight refused = Night(fresh, mapped);
  EXPECT_FALSE(refused.published);
  EXPECT_EQ(Judges(refused, false), std::vector<std::string>{mapped[2].identity()});
  fresh.push_back(Log(4));
  const AreaNight night = Night(fresh, mapped);
  EXPECT_TRUE(night.published) << (night.reasons.empty() ? "" : night.reasons.front());
  EXPECT_EQ(Judges(night, false), std::vector<std::string>{mapped[1].identity()});
  EXPECT_EQ(Judges(night, true), std::vector<std::string>{fresh[1].identity()});
  EXPECT_EQ(night.judgement->judged_by, JudgedBy::kShiftsAndFolds);
  EXPECT_EQ(night.judgement->tests.front().result.shifts, 2);
}

// A run that makes every map worse, and that nothing else tells from the others.
TEST_F(AreaNightTest, RunsOfARefusedVersionAreHeldIfTheMapIsGoodWithoutThem) {
  const std::vector<LogHead> mapped = {Log(0), Log(1)};
  ASSERT_TRUE(Night(mapped).published);
  std::vector<LogHead> fresh = {Log(2)};
  CommitMoved(fresh, 1.0);
  EXPECT_FALSE(Night(fresh, mapped).published);
  fresh.push_back(Log(3));
  CommitMoved(fresh, 1.0);
  const AreaNight night = Night(fresh, mapped);
  EXPECT_TRUE(night.published);
  const std::vector<Exclusion> held = *Store().Exclusions("floor");
  ASSERT_EQ(held.size(), 1u);
  EXPECT_EQ(held.front().run, fresh.front().identity());
  EXPECT_TRUE(held.front().held);
}

TEST_F(AreaNightTest, OfRefusedVersionsOnlyTheNewestKeepsItsContent) {
  const std::vector<LogHead> mapped = {Log(0), Log(1)};
  ASSERT_TRUE(Night(mapped).published);
  std::vector<LogHead> fresh;
  std::vector<VersionNumber> refused;
  const auto stored = [&] {
    std::vector<VersionNumber> of;
    const std::vector<VersionSummary> versions = *Store().Versions("floor");
    for (const VersionSummary& version : versions) {
      const bool among =
          std::find(refused.begin(), refused.end(), version.version) != refused.end();
      if (among && version.content_stored) of.push_back(version.version);
    }
    return of;
  };
  for (int night = 1; night <= 3; ++night) {
    fresh.push_back(Log(1 + night));
    refused.push_back(CommitMoved(fresh, 1.0));
    if (night > 1) CommitMoved({fresh.back()}, 1.0);
    EXPECT_FALSE(Night(fresh, mapped).published);
    EXPECT_EQ(stored(), std::vector<VersionNumber>{refused.back()}) << night;
  }
  fresh.push_back(Log(5));
  EXPECT_TRUE(Night(fresh, mapped).published);
  EXPECT_TRUE(stored().empty());
  // Why they were refused stays.
  EXPECT_EQ(Store().AuditLog("floor", {AuditAction::kRefuse})->size(), refused.size());
  const StatusOr<VerifyResult> verified = VerifyStore(night_.build.store);
  ASSERT_THAT(verified.status(), IsOk());
  EXPECT_TRUE(verified->clean());
}

TEST_F(AreaNightTest, LandmarksThatMovedBlockNothing) {
  OpenWorldOptions options;
  options.groups = 12;
  options.size_m = 20.0;
  options.duration_s = 60.0;
  options.runs = 4;
  options.vehicles = 2;
  options.mode_change_probability = 0.6;
  world_ = *SimulateOpen(options);
  const std::vector<LogHead> mapped = {Log(0), Log(1)};
  ASSERT_TRUE(Night(mapped).published);
  const AreaNight night = Night({Log(2), Log(3)}, mapped);
  EXPECT_TRUE(night.published) << (night.reasons.empty() ? "" : night.reasons.front());
  ASSERT_TRUE(night.judgement);
  EXPECT_GT(night.judgement->modes_made, 2);
  EXPECT_TRUE(night.judgement->suspects.empty());
}

TEST_F(AreaNightTest, AVersionThatWaitsToBeJudgedIsTakenUpAndNotBuiltAgain) {
  const std::vector<LogHead> mapped = {Log(0), Log(1)};
  ASSERT_TRUE(Night(mapped).published);
  const std::vector<LogHead> fresh = {Log(2)};
  const VersionNumber waits = CommitMoved(fresh, 0.001);
  const AreaNight night = Night(fresh, mapped);
  EXPECT_EQ(night.version, waits);
  EXPECT_TRUE(night.published);
}

// Logs of earlier days are gone: each of the night's own shifts is judged on a map without it.
TEST_F(AreaNightTest, WhereNoOtherShiftsAreThereFoldsAreTheJudge) {
  ASSERT_TRUE(Night({Log(0), Log(1)}).published);
  const AreaNight night = Night({Log(2), Log(3), Log(4)});
  EXPECT_TRUE(night.published) << (night.reasons.empty() ? "" : night.reasons.front());
  ASSERT_TRUE(night.judgement);
  EXPECT_EQ(night.judgement->judged_by, JudgedBy::kFolds);
  std::map<std::string, int> folds;
  for (const JudgedShift& shift : night.judgement->shifts) {
    if (shift.fold > 0) folds[shift.run] = shift.fold;
  }
  EXPECT_EQ(folds.size(), 3u);
  for (const auto& test : night.judgement->tests) EXPECT_EQ(test.result.shifts, 3) << test.name;
  // What folds are built for is not stored.
  EXPECT_EQ(Store().Versions("floor")->size(), 2u);
}

// Folds say nothing of a version that is not what its logs give.
TEST_F(AreaNightTest, FoldsExcuseNoVersionThatIsWorse) {
  ASSERT_TRUE(Night({Log(0), Log(1)}).published);
  const std::vector<LogHead> fresh = {Log(2), Log(3)};
  CommitMoved(fresh, 1.0);
  const AreaNight night = Night(fresh);
  EXPECT_FALSE(night.published);
  ASSERT_TRUE(night.judgement);
  EXPECT_EQ(night.judgement->judged_by, JudgedBy::kFolds);
}

// The rest of a log that comes while its first part is built.
TEST_F(AreaNightTest, ALogThatGrewSinceItWasReadIsNotCommitted) {
  const LogHead log = Log(0);
  std::ostringstream err;
  Context context(CommonOptions(), &err);
  const StopSignals signals;
  AreaBuildOptions options = night_.build;
  options.area = "floor";
  options.logs = {log.path};
  for (const bool grows : {true, false}) {
    StatusOr<AreaBuild> build = MakeAreaBuild(options, context);
    ASSERT_THAT(build, IsOk());
    if (grows) std::ofstream(log.path, std::ios::app) << "more";
    const Status committed = CommitArea(options, context, &*build);
    if (grows) {
      EXPECT_THAT(committed, StatusIs(StatusCode::kAborted, "changed after the build had read it"));
      Log(0);
    } else {
      EXPECT_THAT(committed, IsOk());
    }
  }
}

TEST(RunName, HasItsFolderWhereAnotherLogHasTheSameName) {
  const std::vector<std::string> paths = {
      "logs/a/run.mcap", "logs/b/run.mcap", "logs/b/other.mcap"};
  const RunNames names(paths);
  EXPECT_EQ(names.Of(paths[0]), "a/run");
  EXPECT_EQ(names.Of(paths[1]), "b/run");
  EXPECT_EQ(names.Of(paths[2]), "other");
  EXPECT_EQ(RunNames({"run.mcap", "b/run.mcap"}).Of("run.mcap"), "run");
}

// A version that a night refused is not the one to be made with other options.
TEST_F(AreaNightTest, AnotherLimitIsAnotherBuild) {
  const AreaBuildOptions usual;
  const std::string key = NightKey({}, usual);
  EXPECT_EQ(NightKey({}, usual), key);
  AreaBuildOptions other = usual;
  other.limits.max_range_m = 20.0;
  EXPECT_NE(NightKey({}, other), key);
  other = usual;
  other.clock_tolerance_s = 60.0;
  EXPECT_NE(NightKey({}, other), key);
  other = usual;
  other.no_learned_rates = true;
  EXPECT_NE(NightKey({}, other), key);
}

TEST_F(AreaNightTest, OneRunAloneIsItsOwnJudge) {
  ASSERT_TRUE(Night({Log(0), Log(1)}).published);
  const AreaNight night = Night({Log(2)});
  EXPECT_TRUE(night.published);
  ASSERT_TRUE(night.judgement);
  EXPECT_EQ(night.judgement->judged_by, JudgedBy::kOwnShifts);
}

TEST_F(AreaNightTest, WhatWasLeftOutForWantOfMemoryIsTriedWithMore) {
  Night({Log(0)});
  MapStore store = Store();
  const std::vector<LogHead> logs = {Log(1)};
  rlimit before;
  ASSERT_EQ(getrlimit(RLIMIT_DATA, &before), 0);
  rlimit lower = before;
  lower.rlim_cur = static_cast<rlim_t>(MemoryBound() / 2);
  ASSERT_EQ(setrlimit(RLIMIT_DATA, &lower), 0);
  const std::set<std::string> left_out = {logs.front().identity()};
  EXPECT_THAT(NoteLeftOut(night_, "floor", logs, left_out, &store), IsOk());
  EXPECT_EQ(ReadLeftOut(night_, "floor", logs, &store).value(), left_out);
  ASSERT_EQ(setrlimit(RLIMIT_DATA, &before), 0);
  EXPECT_EQ(ReadLeftOut(night_, "floor", logs, &store).value(), std::set<std::string>());
}

}  // namespace
}  // namespace shiftmap
