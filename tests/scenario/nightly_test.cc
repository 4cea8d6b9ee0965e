// SPDX-License-Identifier: Apache-2.0
//
// The nightly job: what vehicles left in a folder goes into the maps, each run and report once.
#include <fcntl.h>
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <sys/file.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <numeric>
#include <string>
#include <vector>

#include "mapstore/codec/run_log.h"
#include "mapstore/codec/shift_report.h"
#include "mapstore/core/clock.h"
#include "mapstore/map/sha256.h"
#include "mapstore/map_store.h"
#include "tests/scenario/background_command.h"
#include "tests/scenario/command.h"
#include "tests/scenario/world.h"
#include "tests/support/status_matchers.h"

namespace shiftmap::testing {
namespace {

namespace fs = std::filesystem;

constexpr int kBadInput = 3;
constexpr int kNothingToDo = 5;
constexpr int kAttention = 8;
constexpr int kTemporary = 75;

class NightlyTest : public ::testing::Test {
 protected:
  NightlyTest() : logs_(world_.File("logs")), store_(world_.File("a.db")) {
    fs::create_directory(logs_);
  }

  // Puts a run into the folder as a recorder on the vehicle would have written it.
  void Bring(
      int run,
      const std::string& name,
      const std::function<void(shiftmap::Run*)>& change = [](shiftmap::Run*) {}) const {
    shiftmap::Run log = ReadRunLog(world_.Log(run))->run;
    log.info.area = "floor";
    change(&log);
    ASSERT_THAT(WriteRunLog(log, logs_ + "/" + name + ".mcap"), IsOk());
  }

  CommandResult Night(const Arguments& more = {"--min-age-s", "0"}) const {
    Arguments words = {"nightly", "--store", store_, "--logs", logs_, "--json"};
    words.insert(words.end(), more.begin(), more.end());
    return RunCommand("shiftmap-mapper", words);
  }

  Json Show(const std::string& store) const {
    return RunForJson("shiftmap-inspect",
                      {"show", "--store", store, "--area", "floor", "--at", "1769000000"});
  }

  World world_{{"--shifts", "4", "--duration-s", "60", "--groups", "10", "--size-m", "20"}};
  std::string logs_;
  std::string store_;
};

TEST_F(NightlyTest, SaysWhatItDidWhereItsPageCannotBeWritten) {
  Bring(0, "monday");
  const CommandResult night = Night({"--min-age-s", "0", "--report", "/proc"});
  EXPECT_EQ(night.exit_code, kAttention) << night.err;
  EXPECT_EQ(Json::parse(night.out)["areas"][0]["published"], true);
  EXPECT_NE(night.err.find("/proc/"), std::string::npos) << night.err;
  EXPECT_EQ(Night().exit_code, kNothingToDo);
}

TEST_F(NightlyTest, EachNightMapsWhatIsNew) {
  Bring(0, "monday");
  fs::create_directory(logs_ + "/truck");
  Bring(1, "truck/monday");
  CommandResult night = Night();
  ASSERT_EQ(night.exit_code, 0) << night.err;
  Json document = Json::parse(night.out);
  ASSERT_EQ(document["areas"].size(), 1u);
  EXPECT_EQ(document["areas"][0]["area"], "floor");
  EXPECT_EQ(document["areas"][0]["runs_new"], 2);
  EXPECT_EQ(document["areas"][0]["version"], 1);
  EXPECT_EQ(document["areas"][0]["published"], true);

  EXPECT_EQ(Night().exit_code, kNothingToDo);

  // A shift comes back with its report and its log, a second one with its report alone.
  Bring(2, "tuesday");
  for (const int run : {2, 3}) {
    const std::string report = logs_ + "/" + std::to_string(run) + ".report";
    const std::string log = run == 2 ? logs_ + "/tuesday.mcap" : world_.Log(run);
    RunForJson("shiftmap-localizer",
               {"run", "--store", store_, "--area", "floor", "--report", report, log});
  }
  night = Night();
  ASSERT_EQ(night.exit_code, 0) << night.err;
  document = Json::parse(night.out);
  EXPECT_EQ(document["reports"]["new"], 2);
  EXPECT_EQ(document["areas"][0]["runs_new"], 1);
  EXPECT_EQ(document["areas"][0]["version"], 2);

  // By hand, in the same order.
  const std::string by_hand = world_.File("by_hand.db");
  RunForJson("shiftmap-mapper",
             {"build",
              "--store",
              by_hand,
              "--area",
              "floor",
              logs_ + "/monday.mcap",
              logs_ + "/truck/monday.mcap"});
  RunForJson("shiftmap-localizer",
             {"return", "--store", by_hand, logs_ + "/2.report", logs_ + "/3.report"});
  RunForJson("shiftmap-mapper",
             {"build", "--store", by_hand, "--area", "floor", logs_ + "/tuesday.mcap"});
  EXPECT_EQ(Show(store_), Show(by_hand));
  EXPECT_EQ(Night().exit_code, kNothingToDo);
}

// One that cannot be used is named, every night, and the others are mapped.
TEST_F(NightlyTest, WhatCannotBeUsedIsNamedAndKeepsNoneOfTheOthers) {
  Bring(0, "good");
  Bring(1, "other_area", [](shiftmap::Run* run) { run->info.area = "hall"; });
  Bring(2, "no_area", [](shiftmap::Run* run) {
    run->info.area.clear();
    for (Scan& scan : run->scans) {
      for (Observation& seen : scan.observations) seen.signature = Signature("elsewhere");
    }
  });
  std::ofstream(logs_ + "/damaged.mcap") << "nothing";
  std::ofstream(logs_ + "/damaged.report") << "no report";
  for (const char* const time : {"first", "second"}) {
    const CommandResult night = Night();
    EXPECT_EQ(night.exit_code, kAttention) << time;
    const Json document = Json::parse(night.out);
    EXPECT_NE(night.err.find("damaged.mcap"), std::string::npos) << night.err;
    if (time == std::string("first")) {
      EXPECT_NE(night.err.find("no_area.mcap' names no area"), std::string::npos) << night.err;
      ASSERT_EQ(document["areas"].size(), 2u);
      EXPECT_EQ(document["areas"][0]["version"], 1);
      EXPECT_EQ(document["areas"][1]["area"], "hall");
      EXPECT_EQ(document["areas"][1]["version"], 1);
    } else {
      EXPECT_NE(night.err.find("damaged.report"), std::string::npos) << night.err;
    }
  }
  // What somebody excludes is named no more, and goes where a limit says so.
  for (const std::string name : {"damaged.mcap", "damaged.report"}) {
    const std::string hash = *HashFile(logs_ + "/" + name);
    RunForJson("shiftmap-inspect",
               {"runs", "exclude", hash, "--store", store_, "--area", "floor", "--reason", "junk"});
  }
  const CommandResult ignored = Night({"--min-age-s", "0", "--log-quota-mib", "0"});
  EXPECT_EQ(ignored.err.find("damaged"), std::string::npos) << ignored.err;
  EXPECT_FALSE(fs::exists(logs_ + "/damaged.mcap"));
  // The one that names no area fits none, and is of the one that is named.
  EXPECT_NE(Night().err.find("names no area, and fits none of the 2 maps"), std::string::npos);
  const CommandResult night = Night({"--area", "floor", "--min-age-s", "0"});
  EXPECT_EQ(night.exit_code, kAttention);
  EXPECT_EQ(Json::parse(night.out)["areas"][0]["runs_new"], 1);
}

TEST_F(NightlyTest, LogAndReportOfAClockThatWasNotSetAreNamedAndStay) {
  Bring(0, "good");
  ASSERT_EQ(Night().exit_code, 0);
  Bring(1, "unset", [](shiftmap::Run* run) {
    const Duration by = Stamp() - run->odometry.front().stamp;
    for (OdometrySample& sample : run->odometry) sample.stamp += by;
    for (Scan& scan : run->scans) scan.stamp += by;
  });
  const std::string report = logs_ + "/unset.report";
  RunForJson(
      "shiftmap-localizer",
      {"run", "--store", store_, "--area", "floor", "--report", report, logs_ + "/unset.mcap"});
  const CommandResult night = Night();
  EXPECT_EQ(night.exit_code, kAttention);
  for (const char* const name : {"/unset.mcap", "/unset.report"}) {
    EXPECT_NE(night.err.find(logs_ + name + "' is left out"), std::string::npos) << night.err;
    EXPECT_TRUE(fs::exists(logs_ + name));
  }
  EXPECT_EQ(Json::parse(night.out)["reports"]["new"], 0);
  RunForJson("shiftmap-inspect",
             {"runs",
              "exclude",
              *HashFile(report),
              "--store",
              store_,
              "--area",
              "floor",
              "--reason",
              "no clock"});
  EXPECT_EQ(Night().err.find("unset.report"), std::string::npos);
}

TEST_F(NightlyTest, AVehicleAtTwoPlacesAtOneTimeIsNamed) {
  const Stamp begin = ReadRunLog(world_.Log(0))->run.odometry.front().stamp;
  for (const int run : {0, 1}) {
    Bring(run, run == 0 ? "monday" : "other", [&](shiftmap::Run* log) {
      log->info.vehicle = "robot";
      const Duration by = begin + run * FromSeconds(30.0) - log->odometry.front().stamp;
      for (OdometrySample& sample : log->odometry) sample.stamp += by;
      for (Scan& scan : log->scans) scan.stamp += by;
    });
  }
  const CommandResult night = Night();
  EXPECT_EQ(night.exit_code, kAttention);
  EXPECT_NE(night.err.find("vehicle 'robot' is in runs '"), std::string::npos) << night.err;
  const std::string reasons = Json::parse(night.out)["areas"][0]["reasons"].dump();
  EXPECT_NE(reasons.find("a clock is wrong, or two vehicles have one name"), std::string::npos);
}

TEST_F(NightlyTest, ALogWhoseClockWasSetWhileItDroveIsHeld) {
  Bring(0, "monday");
  ASSERT_EQ(Night().exit_code, 0);
  Bring(1, "tuesday", [](shiftmap::Run* log) {
    const Stamp middle = log->odometry[log->odometry.size() / 2].stamp;
    const Duration by = FromSeconds(8 * 3600.0);
    for (OdometrySample& sample : log->odometry) {
      if (sample.stamp > middle) sample.stamp += by;
    }
    for (Scan& scan : log->scans) {
      if (scan.stamp > middle) scan.stamp += by;
    }
  });
  Bring(2, "wednesday");
  const CommandResult night = Night();
  EXPECT_EQ(night.exit_code, kAttention) << night.err;
  EXPECT_NE(night.err.find("tuesday.mcap' is left out of the map and held: its clock was set, or "
                           "two runs are in it: there is nothing for 8.0 h after "),
            std::string::npos)
      << night.err;
  EXPECT_EQ(Json::parse(night.out)["areas"][0]["runs_new"], 1);
}

// Whenever the edit comes, the map that is published holds it, and no run is to blame.
TEST_F(NightlyTest, AnEditWhileTheNightBuildsIsInItsMap) {
  for (const int run : {0, 1}) Bring(run, fmt::format("run_{}", run));
  ASSERT_EQ(Night().exit_code, 0);
  for (const int run : {2, 3}) Bring(run, fmt::format("run_{}", run));
  const std::string before = store_ + ".before";
  fs::copy_file(store_, before);
  const std::string landmark = Show(store_)["groups"][0]["signature"];
  for (const int delay_ms : {50, 100, 200, 300, 450}) {
    fs::copy_file(before, store_, fs::copy_options::overwrite_existing);
    BackgroundCommand night(
        "shiftmap-mapper",
        {"nightly", "--store", store_, "--logs", logs_, "--min-age-s", "0", "--threads", "1"});
    usleep(static_cast<useconds_t>(1000 * delay_ms * kSlowdown));
    const CommandResult edit = RunCommand("shiftmap-inspect",
                                          {"edit",
                                           "rename",
                                           landmark,
                                           "new name",
                                           "--store",
                                           store_,
                                           "--area",
                                           "floor",
                                           "--reason",
                                           "test"});
    EXPECT_EQ(edit.exit_code, 0) << edit.err;
    EXPECT_EQ(night.End(0), 0) << delay_ms << ": " << night.Errors();
    MapStore store = *MapStore::Open(store_, MapStore::Access::kReadOnly);
    const auto published = *store.PublishedVersion("floor");
    EXPECT_EQ(store.RunIdentities("floor", *published)->size(), 4u) << delay_ms;
    EXPECT_EQ(store.EditsOf("floor", *published)->size(), 1u) << delay_ms;
  }
}

// Scans that had landmarks well in view where they stood, over the runs of a version's line.
int ScansInView(const std::string& path, int version) {
  MapStore store = *MapStore::Open(path, MapStore::Access::kReadOnly);
  const std::vector<ModeVisibility> modes =
      *store.MappedVisibility("floor", VersionNumber(version));
  int scans = 0;
  for (const ModeVisibility& mode : modes) {
    scans += std::accumulate(mode.scans.seen.begin(), mode.scans.seen.end(), 0);
  }
  return scans;
}

TEST_F(NightlyTest, AFileInPlaceOfTheFolderOfLogsStaysOne) {
  ExpectError(
      "shiftmap-mapper", {"nightly", "--store", store_, "--logs", world_.Log(0)}, 3, "is a file");
}

TEST_F(NightlyTest, WhatEachRunSawIsKept) {
  Bring(0, "monday");
  ASSERT_EQ(Night().exit_code, 0);
  Bring(1, "tuesday");
  ASSERT_EQ(Night().exit_code, 0);
  const int first = ScansInView(store_, 1);
  const int both = ScansInView(store_, 2);
  EXPECT_GT(first, 50);
  EXPECT_GT(both, first + 50);
}

TEST_F(NightlyTest, AnExcludedRunIsNotMapped) {
  Bring(0, "good");
  ASSERT_EQ(Night().exit_code, 0);
  const std::string vehicle = ReadRunLog(world_.Log(1))->run.info.vehicle;
  RunForJson("shiftmap-inspect",
             {"runs",
              "exclude",
              "--vehicle",
              vehicle,
              "--since",
              "1767000000",
              "--reason",
              "slips",
              "--store",
              store_,
              "--area",
              "floor"});
  Bring(1, "bad");
  EXPECT_EQ(Night().exit_code, kNothingToDo);
  RunForJson("shiftmap-inspect",
             {"runs", "include", "--vehicle", vehicle, "--store", store_, "--area", "floor"});
  EXPECT_EQ(Night().exit_code, 0);
}

// Each of three nights maps a run.
class ThreeNightsTest : public NightlyTest {
 protected:
  ThreeNightsTest() {
    int run = 0;
    for (const char* const name : {"first", "second", "third"}) {
      Bring(run++, name);
      EXPECT_EQ(Night().exit_code, 0) << name;
    }
  }

  CommandResult Inspect(Arguments words) const {
    words.insert(words.end(), {"--store", store_, "--area", "floor"});
    return RunCommand("shiftmap-inspect", words);
  }

  CommandResult Exclude(const std::string& name) const {
    const std::string run = *HashFile(logs_ + "/" + name + ".mcap");
    return Inspect({"runs", "exclude", run, "--reason", "slips"});
  }

  std::vector<std::string> PublishedRuns() const {
    MapStore store = *MapStore::Open(store_, MapStore::Access::kReadOnly);
    const std::vector<LineRun> runs = *store.LineRuns("floor", **store.PublishedVersion("floor"));
    std::vector<std::string> names;
    for (const LineRun& of : runs) names.push_back(of.run.name);
    return names;
  }

  // The night builds the map of these runs without a prior. The oracle is a store that never had
  // the other one.
  void ExpectAnew(const std::vector<std::string>& runs) const {
    const Json planned = Json::parse(Night({"--min-age-s", "0", "--dry-run"}).out)["areas"][0];
    EXPECT_EQ(planned["runs_again"], 2);
    const CommandResult night = Night();
    ASSERT_EQ(night.exit_code, 0) << night.err;
    const Json area = Json::parse(night.out)["areas"][0];
    EXPECT_EQ(area["version"], 4);
    EXPECT_EQ(area["published"], true);
    EXPECT_EQ(area["runs_new"], 0);
    EXPECT_EQ(area["runs_again"], 2);
    EXPECT_EQ(PublishedRuns(), runs);

    const std::string others = world_.File("others");
    fs::create_directory(others);
    for (const std::string& run : runs) {
      fs::copy_file(logs_ + "/" + run + ".mcap", others + "/" + run + ".mcap");
    }
    const Json clean = RunForJson(
        "shiftmap-mapper",
        {"nightly", "--store", world_.File("b.db"), "--logs", others, "--min-age-s", "0"});
    EXPECT_EQ(area["content_hash"], clean["areas"][0]["content_hash"]);
    EXPECT_EQ(Night().exit_code, kNothingToDo);
  }
};

// The first build's run is excluded, so that no version is left to go on from.
class AnewTest : public ThreeNightsTest {
 protected:
  AnewTest() {
    const CommandResult excluded = Exclude("first");
    EXPECT_NE(excluded.err.find("builds start anew"), std::string::npos) << excluded.err;
  }
};

TEST_F(AnewTest, TheNightBuildsTheOthersWithoutAPrior) { ExpectAnew({"second", "third"}); }

// What the published map has and no build takes: the next build would leave it out again.
TEST_F(AnewTest, WhatABuildLeftOutIsNotBuiltAgainUntilSomethingChanges) {
  const Arguments little = {"--min-age-s", "0", "--max-memory-mib", "1"};
  const auto audit = [&] { return Inspect({"audit"}).out; };
  const CommandResult first = Night(little);
  EXPECT_EQ(first.exit_code, kAttention);
  EXPECT_NE(first.err.find("MiB"), std::string::npos) << first.err;
  const std::string noted = audit();
  EXPECT_NE(noted.find("leave"), std::string::npos) << noted;
  const CommandResult again = Night(little);
  EXPECT_EQ(again.exit_code, kAttention);
  EXPECT_EQ(again.err.find("MiB"), std::string::npos) << again.err;
  for (const char* const name : {"second", "third"}) {
    EXPECT_NE(again.err.find(logs_ + "/" + name + ".mcap' is left out as in an earlier night"),
              std::string::npos)
        << again.err;
  }
  EXPECT_EQ(audit(), noted);
  // A decision is a change.
  const std::string third = *HashFile(logs_ + "/third.mcap");
  EXPECT_EQ(Inspect({"runs", "hold", third, "--reason", "?"}).exit_code, 0);
  EXPECT_NE(Night(little).err.find("MiB"), std::string::npos);
  EXPECT_EQ(Inspect({"runs", "include", third}).exit_code, 0);
  ExpectAnew({"second", "third"});
}

// So does it where the store does not have the ancestor that is left.
TEST_F(ThreeNightsTest, AncestorsThatWereCompactedAwayAreNoPrior) {
  RunForJson("shiftmap-inspect", {"compact", "--keep-versions", "1", "--store", store_});
  const CommandResult excluded = Exclude("third");
  EXPECT_EQ(excluded.exit_code, 0);
  EXPECT_NE(excluded.err.find("no stored ancestor is without it, builds start anew"),
            std::string::npos)
      << excluded.err;
  const CommandResult built = RunCommand(
      "shiftmap-mapper", {"build", "--store", store_, "--area", "floor", logs_ + "/second.mcap"});
  EXPECT_EQ(built.exit_code, kBadInput);
  EXPECT_NE(built.err.find("--prior none"), std::string::npos) << built.err;
  ExpectAnew({"first", "second"});
}

// The line about a log says what brings its version back, of whichever was rolled back.
TEST_F(ThreeNightsTest, OfVersionsThatWereRolledBackTheCommandIsSaid) {
  ASSERT_EQ(Inspect({"rollback", "1"}).exit_code, 0);
  const CommandResult night = Night();
  EXPECT_EQ(night.exit_code, kAttention);
  EXPECT_NE(night.err.find("shiftmap-inspect publish 2, or build"), std::string::npos) << night.err;
  EXPECT_NE(night.err.find("shiftmap-inspect publish 3 --expected 1, or build"), std::string::npos)
      << night.err;
  EXPECT_EQ(Inspect({"publish", "3", "--expected", "1"}).exit_code, 0);
}

// Its log was deleted: a person decides whether the map is worth the run.
TEST_F(AnewTest, AMapThatLacksAnotherRunIsNotPublishedByItself) {
  fs::remove(logs_ + "/second.mcap");
  for (const char* const time : {"first", "again"}) {
    const CommandResult night = Night();
    EXPECT_EQ(night.exit_code, kAttention) << time;
    EXPECT_NE(night.err.find("run 'second' is not in the new map"), std::string::npos) << night.err;
    EXPECT_NE(night.err.find("publish 4 --expected 3"), std::string::npos) << night.err;
    const Json area = Json::parse(night.out)["areas"][0];
    EXPECT_EQ(area["version"], 4) << time;
    EXPECT_EQ(area["published"], false);
  }
  // As the line says.
  RunForJson("shiftmap-inspect",
             {"publish", "4", "--expected", "3", "--store", store_, "--area", "floor"});
  EXPECT_EQ(PublishedRuns(), std::vector<std::string>{"third"});
  EXPECT_EQ(Night().exit_code, kNothingToDo);
}

TEST_F(AnewTest, AMapThatLacksAnEditIsNotPublishedByItself) {
  RunForJson(
      "shiftmap-inspect",
      {"edit", "rename", "L01", "gate", "--reason", "named", "--store", store_, "--area", "floor"});
  const CommandResult night = Night();
  EXPECT_EQ(night.exit_code, kAttention);
  EXPECT_NE(night.err.find("edit 1 (rename 'L01') is not in the new map, to be made again"),
            std::string::npos)
      << night.err;
}

// What a map lacks is no matter of judging.
TEST_F(AnewTest, AMapThatLacksSomethingIsNotPublishedUnjudgedEither) {
  RunForJson(
      "shiftmap-inspect",
      {"edit", "rename", "L01", "gate", "--reason", "named", "--store", store_, "--area", "floor"});
  const std::vector<std::string> runs = PublishedRuns();
  fs::remove(logs_ + "/second.mcap");
  for (const char* const time : {"first", "again"}) {
    const CommandResult night = Night({"--min-age-s", "0", "--no-judge"});
    EXPECT_EQ(night.exit_code, kAttention) << time;
    EXPECT_NE(night.err.find("run 'second' is not in the new map"), std::string::npos) << night.err;
    EXPECT_NE(night.err.find("edit 1 (rename 'L01') is not in the new map"), std::string::npos)
        << night.err;
    const Json area = Json::parse(night.out)["areas"][0];
    EXPECT_EQ(area["version"], 5) << time;
    EXPECT_EQ(area["published"], false);
  }
  EXPECT_EQ(PublishedRuns(), runs);
  // What comes back completes it.
  Bring(1, "second");
  RunForJson("shiftmap-inspect",
             {"edit", "undo", "1", "--reason", "wrong", "--store", store_, "--area", "floor"});
  EXPECT_EQ(Night({"--min-age-s", "0", "--no-judge"}).exit_code, 0);
  EXPECT_EQ(PublishedRuns(), (std::vector<std::string>{"second", "third"}));
}

TEST_F(NightlyTest, AHeldRunIsNamedEveryNight) {
  Bring(0, "good");
  ASSERT_EQ(Night().exit_code, 0);
  const std::vector<std::string> at = {"--store", store_, "--area", "floor"};
  const auto decide = [&](std::vector<std::string> words) {
    words.insert(words.end(), at.begin(), at.end());
    return RunForJson("shiftmap-inspect", words);
  };
  const std::string vehicle = ReadRunLog(world_.Log(1))->run.info.vehicle;
  decide({"runs", "hold", "--vehicle", vehicle, "--since", "1767000000", "--reason", "new wheels"});
  Bring(1, "other");
  for (int night = 0; night < 2; ++night) {
    const CommandResult result = Night();
    EXPECT_EQ(result.exit_code, kAttention);
    EXPECT_NE(result.err.find("other.mcap' is held: new wheels"), std::string::npos) << result.err;
  }
  EXPECT_EQ(decide({"runs"})["exclusions"][0]["state"], "held");
  decide({"runs", "include", "--vehicle", vehicle});
  EXPECT_EQ(decide({"runs"})["exclusions"].size(), 0u);
  EXPECT_EQ(Night().exit_code, 0);
}

TEST_F(NightlyTest, ARunIsExcludedByItsHashToo) {
  Bring(0, "good");
  ASSERT_EQ(Night().exit_code, 0);
  Bring(1, "bad", [](shiftmap::Run* run) {
    run->info.uuid = "0f8fad5b-d9cb-469f-a165-70867728950e";
  });
  // A localizer of the release before sends the hash alone.
  const std::string path = logs_ + "/bad.report";
  RunForJson("shiftmap-localizer",
             {"run", "--store", store_, "--area", "floor", "--report", path, logs_ + "/bad.mcap"});
  ShiftReport report = *ReadShiftReport(path);
  report.run_uuid.clear();
  ASSERT_THAT(WriteShiftReport(report, path), IsOk());
  RunForJson("shiftmap-localizer", {"return", "--store", store_, path});
  RunForJson("shiftmap-inspect",
             {"runs",
              "exclude",
              report.run_hash,
              "--reason",
              "slips",
              "--store",
              store_,
              "--area",
              "floor"});
  const CommandResult night = Night();
  EXPECT_EQ(night.exit_code, kNothingToDo) << night.err;
}

TEST_F(NightlyTest, OneNightAtATime) {
  Bring(0, "good");
  const int fd = open((store_ + ".nightly").c_str(), O_RDWR | O_CREAT, 0600);
  ASSERT_EQ(flock(fd, LOCK_EX), 0);
  EXPECT_EQ(Night().exit_code, kTemporary);
  close(fd);
  EXPECT_EQ(Night().exit_code, 0);
}

// As a power cut leaves it after the map is published and before there is a page.
TEST_F(NightlyTest, WhatAnInterruptedNightPublishedIsNamedOnTheNextPage) {
  Bring(0, "monday");
  ASSERT_EQ(Night().exit_code, 0);
  std::ofstream(store_ + ".nightly") << ToNanoseconds(SystemNow()) - 600'000'000'000;
  const std::string pages = world_.File("pages");
  const CommandResult night = Night({"--min-age-s", "0", "--report", pages});
  EXPECT_EQ(night.exit_code, kAttention) << night.err;
  EXPECT_NE(night.err.find("area 'floor': version 1 was published since the night of"),
            std::string::npos)
      << night.err;
  EXPECT_EQ(std::distance(fs::directory_iterator(pages), fs::directory_iterator()), 2);
  EXPECT_EQ(Night().exit_code, kNothingToDo);
}

TEST_F(NightlyTest, ALogThatMayNotBeWholeWaitsForAnotherNight) {
  Bring(0, "good");
  const CommandResult night = Night({"--min-age-s", "1000"});
  EXPECT_EQ(night.exit_code, kAttention);
  EXPECT_TRUE(Json::parse(night.out)["areas"].empty());
  EXPECT_FALSE(fs::exists(store_));
}

// By the parameter, logs have the UUID of their run or not.
class CutOffTest : public NightlyTest, public ::testing::WithParamInterface<const char*> {
 protected:
  static void Name(shiftmap::Run* run) { run->info.uuid = GetParam(); }
  static void Cut(shiftmap::Run* run) {
    Name(run);
    run->odometry.resize(run->odometry.size() / 2);
    std::erase_if(run->scans,
                  [&](const Scan& scan) { return scan.stamp > run->odometry.back().stamp; });
  }
  static void Sparse(shiftmap::Run* run) {
    Name(run);
    run->scans.resize(run->scans.size() / 3);
  }

  // A log that a part is mapped of is named until somebody takes that part back and builds with it.
  void ExpectRestIsNamed(void (*part)(shiftmap::Run*), const std::string& what) const {
    Bring(1, "other");
    ASSERT_EQ(Night().exit_code, 0);
    Bring(0, "run", part);
    ASSERT_EQ(Night().exit_code, 0);
    EXPECT_EQ(Night().exit_code, kNothingToDo);
    Bring(0, "run", Name);
    for (const char* const time : {"first", "second"}) {
      const CommandResult night = Night();
      EXPECT_EQ(night.exit_code, kAttention) << time;
      EXPECT_NE(night.err.find("version 2 was built from " + what), std::string::npos)
          << time << night.err;
      EXPECT_EQ(night.err.find("clock"), std::string::npos) << time << night.err;
    }
    const Arguments store = {"--store", store_, "--area", "floor"};
    const auto with = [&](const std::string& command, const Arguments& more = {}) {
      Arguments words = {command};
      words.insert(words.end(), store.begin(), store.end());
      words.insert(words.end(), more.begin(), more.end());
      return words;
    };
    ExpectError("shiftmap-mapper",
                with("build", {logs_ + "/run.mcap"}),
                kNothingToDo,
                "run.mcap': version 2 was built from " + what);
    RunForJson("shiftmap-inspect", with("rollback"));
    RunForJson("shiftmap-mapper", with("build", {logs_ + "/run.mcap"}));
    const Json runs = RunForJson("shiftmap-inspect", with("runs"))["runs"];
    ASSERT_EQ(runs.size(), 1u);
    EXPECT_NEAR(runs[0]["end_s"].get<double>() - runs[0]["begin_s"].get<double>(), 60.0, 1.0);
    EXPECT_EQ(Night().exit_code, kNothingToDo);
  }
};

INSTANTIATE_TEST_SUITE_P(Uuids,
                         CutOffTest,
                         ::testing::Values("", "0f8fad5b-d9cb-469f-a165-70867728950e"),
                         [](const auto& uuid) { return *uuid.param == '\0' ? "None" : "One"; });

// Of copies of one run the longest is mapped, once.
TEST_P(CutOffTest, ACopyIsNoOtherRun) {
  Bring(0, "a_cut", Cut);
  Bring(0, "whole", Name);
  Bring(0, "z_cut", [](shiftmap::Run* run) {
    Cut(run);
    run->odometry.pop_back();
  });
  CommandResult night = Night();
  EXPECT_EQ(night.exit_code, kAttention) << night.err;
  EXPECT_NE(night.err.find("a copy of the run, not longer than"), std::string::npos) << night.err;
  const std::string left_out = "run 'a_cut' is left out";
  EXPECT_EQ(night.err.find(left_out), night.err.rfind(left_out)) << "said twice: " << night.err;
  const Json runs =
      RunForJson("shiftmap-inspect", {"runs", "--store", store_, "--area", "floor"})["runs"];
  ASSERT_EQ(runs.size(), 1u);
  EXPECT_EQ(runs[0]["run"], "whole");
  EXPECT_EQ(Night().exit_code, kNothingToDo);
}

TEST_P(CutOffTest, AFileUnderTwoNamesIsOneRun) {
  const auto copy = [&](const std::string& from, const std::string& to) {
    fs::copy_file(logs_ + "/" + from + ".mcap", logs_ + "/" + to + ".mcap");
  };
  Bring(0, "run", Name);
  copy("run", "same");
  CommandResult night = Night();
  EXPECT_EQ(night.exit_code, 0) << night.err;
  EXPECT_EQ(Json::parse(night.out)["areas"][0]["runs_new"], 1);
  copy("run", "later");
  EXPECT_EQ(Night().exit_code, kNothingToDo);

  Bring(1, "other");
  copy("other", "another");
  night = Night();
  ASSERT_EQ(night.exit_code, 0) << night.err;
  const Json area = Json::parse(night.out)["areas"][0];
  EXPECT_EQ(area["runs_new"], 1);
  std::vector<std::string> judges;
  for (const Json& shift : area["judgement"]["shifts"]) {
    if (shift["fold"].is_null()) judges.push_back(shift["run"]);
  }
  EXPECT_EQ(judges.size(), 2u) << area["judgement"]["shifts"];
  // All files of what is mapped may go.
  EXPECT_EQ(Json::parse(Night({"--min-age-s", "0", "--log-quota-mib", "0"}).out)["logs_deleted"],
            5);
}

// As an export of some of the sightings, with all odometry.
TEST_P(CutOffTest, OfLogsOfOneRunTheOneWithMoreSightingsIsMapped) {
  const auto keep = [](std::size_t from, std::size_t step) {
    return [=](shiftmap::Run* run) {
      Name(run);
      std::vector<Scan> kept;
      for (std::size_t i = from; i < run->scans.size(); i += step) kept.push_back(run->scans[i]);
      run->scans = kept;
    };
  };
  Bring(0, "a_none", [](shiftmap::Run* run) {
    Name(run);
    run->scans.clear();
  });
  Bring(0, "b_part", Sparse);
  Bring(0, "c_even", keep(0, 2));
  Bring(0, "d_odd", keep(1, 4));
  Bring(0, "whole", Name);
  for (const std::string whole : {"c_even", "whole"}) {
    const std::string store = world_.File(whole + ".db");
    Arguments words = {"build", "--store", store, "--area", "floor"};
    for (const char* const name : {"a_none", "b_part", "c_even", "d_odd"}) {
      words.push_back(logs_ + "/" + name + ".mcap");
    }
    if (whole == "whole") words.push_back(logs_ + "/whole.mcap");
    const CommandResult built = RunCommand("shiftmap-mapper", words);
    ASSERT_EQ(built.exit_code, 0) << built.err;
    EXPECT_NE(built.err.find("a_none.mcap': a copy of the run, not longer than"), std::string::npos)
        << built.err;
    EXPECT_NE(built.err.find("d_odd.mcap': has other scans of the run"), std::string::npos)
        << built.err;
    MapStore opened = *MapStore::Open(store, MapStore::Access::kReadOnly);
    const std::vector<LineRun> runs = *opened.LineRuns("floor", VersionNumber(1));
    ASSERT_EQ(runs.size(), 1u);
    EXPECT_EQ(runs[0].run.name, whole);
  }
  CommandResult night = Night();
  EXPECT_EQ(night.exit_code, kAttention) << night.err;
  EXPECT_EQ(Json::parse(night.out)["areas"][0]["runs_new"], 1);
  EXPECT_EQ(Night().exit_code, kNothingToDo);
}

TEST_P(CutOffTest, TheRestIsNamed) { ExpectRestIsNamed(Cut, "a shorter copy"); }

TEST_P(CutOffTest, MoreSightingsAreNamed) {
  ExpectRestIsNamed(Sparse, "another log of it, which has");
}

}  // namespace
}  // namespace shiftmap::testing
