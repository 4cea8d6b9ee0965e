// SPDX-License-Identifier: Apache-2.0
//
// The commands that change or check a store: what they say, their exit codes, and dry runs.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <random>
#include <sstream>

#include "mapstore/map_store.h"
#include "tests/support/random_map.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tools/inspect/inspect_commands.h"

namespace shiftmap {
namespace {

using ::testing::HasSubstr;
using testing::IsOk;
using ::testing::Not;

struct Outcome {
  int code;
  std::string out;
  std::string err;

  Json json() const { return Json::parse(out); }
};

// A store with versions 1, its child 2 (published) and 2's child 3, and a report against 2.
class StoreCommands : public ::testing::Test {
 protected:
  void SetUp() override {
    std::mt19937_64 random(testing::TestSeed(61));
    MapContent content = testing::RandomContent(random, {.groups = 5});
    MapStore store = *MapStore::Open(store_, MapStore::Access::kReadWriteCreate);
    const CommitResult first = *store.Commit("hall", content, {}, {});
    content.groups[1].modes[0].p_map_landmark.x() += 0.5;
    const CommitResult second = *store.Commit("hall", content, {}, {.parent = first.version});
    ASSERT_THAT(store.Commit("hall", content, {}, {.parent = second.version, .publish = false}),
                IsOk());
    ShiftReport report;
    report.uuid = "00000000-0000-4000-8000-000000000001";
    report.run_uuid = "0f8fad5b-d9cb-469f-a165-70867728950e";
    report.vehicle = "truck";
    report.software = "test";
    report.area = "hall";
    report.version = second.version;
    report.content_hash = second.content_hash;
    report.begin = content.stamp;
    report.end = content.stamp + FromSeconds(60.0);
    report.evidence = {
        testing::RandomEvidence(random, content.groups[0], report.begin, report.end)};
    ASSERT_THAT(store.Return(report), IsOk());
    signature_ = content.groups[1].signature.text();
  }

  // Of this store, and its area unless the command is about the whole store.
  Outcome Run(std::vector<std::string> arguments, bool with_area = true) {
    arguments.insert(arguments.end(), {"--store", store_});
    if (with_area) arguments.insert(arguments.end(), {"--area", "hall"});
    return RunAsIs(std::move(arguments));
  }

  static Outcome RunAsIs(std::vector<std::string> arguments) {
    Application application("shiftmap-inspect", "");
    AddInspectCommands(&application);
    std::ostringstream out;
    std::ostringstream err;
    const ExitCode code = application.Run(arguments, &out, &err);
    return {static_cast<int>(code), out.str(), err.str()};
  }

  std::int64_t Published() {
    return (*MapStore::Open(store_, MapStore::Access::kReadOnly))
        .PublishedVersion("hall")
        ->value()
        .value();
  }

  testing::TempDir dir_;
  std::string store_ = dir_.File("maps.db");
  std::string signature_;
};

TEST_F(StoreCommands, DiffNamesWhatMoved) {
  const Outcome diff = Run({"diff", "1", "2", "--json"});
  ASSERT_EQ(diff.code, 0) << diff.err;
  const Json groups = diff.json()["groups"];
  ASSERT_EQ(groups.size(), 1U);
  EXPECT_EQ(groups[0]["signature"], signature_);
  EXPECT_NEAR(groups[0]["modes_moved"][0]["dx_m"].get<double>(), 0.5, 1e-12);
  EXPECT_THAT(Run({"diff", "1", "2"}).out, HasSubstr("0.500 m"));
  EXPECT_EQ(Run({"diff", "2", "3"}).out, "no difference\n");
  EXPECT_EQ(Run({"diff", "1", "2", "--min-move-sigma", "1e6"}).out, "no difference\n");
  EXPECT_THAT(Run({"diff", "a", "2"}).err, HasSubstr("FROM: 'a' is no number"));
  EXPECT_EQ(Run({"diff", "1", "9"}).code, 6);
  EXPECT_EQ(Run({"diff", "1"}).code, 2);
}

// Nobody sees what the digits do not show; the document has all of it.
TEST_F(StoreCommands, DiffCountsWhatDoesNotShowAsUnchanged) {
  {
    MapStore store = *MapStore::Open(store_, MapStore::Access::kReadWrite);
    MapContent content = store.LoadVersion("hall", VersionNumber(2))->content();
    for (LandmarkGroup& group : content.groups) {
      group.modes[0].p_map_landmark.x() += 1e-6;
      group.probabilities(0) += 1e-5 * group.probabilities(1);
      group.probabilities(1) -= 1e-5 * group.probabilities(1);
    }
    content.groups[0].modes[0].p_map_landmark.x() += 0.5;
    ASSERT_THAT(store.Commit("hall", content, {}, {.parent = VersionNumber(2)}), IsOk());
  }
  const Outcome diff = Run({"diff", "2", "4"});
  ASSERT_EQ(diff.code, 0) << diff.err;
  EXPECT_THAT(diff.out, HasSubstr("unchanged: 4 landmarks"));
  EXPECT_THAT(diff.out, Not(HasSubstr("0.000 m")));
  EXPECT_EQ(Run({"diff", "2", "4", "--json"}).json()["groups"].size(), 5U);
}

TEST_F(StoreCommands, PublishIsCompareAndSwap) {
  EXPECT_EQ(Run({"publish", "2"}).code, 5);
  EXPECT_EQ(Run({"publish", "9"}).code, 6);
  // Version 1 has no parent: it may be published where nothing is.
  const Outcome moved = Run({"publish", "1"});
  EXPECT_EQ(moved.code, 4);
  EXPECT_THAT(moved.err, HasSubstr("version 2 is published, expected no version"));
  EXPECT_EQ(Run({"publish", "1", "--dry-run"}).code, 4);
  EXPECT_THAT(Run({"publish", "3", "--dry-run"}).out, HasSubstr("would be published"));
  EXPECT_EQ(Published(), 2);
  const Outcome published = Run({"publish", "3", "--json"});
  EXPECT_EQ(published.code, 0) << published.err;
  EXPECT_EQ(published.json()["published"], 3);
  EXPECT_EQ(Run({"publish", "1", "--expected", "2"}).code, 4);
  EXPECT_EQ(Run({"publish", "1", "--expected", "3"}).code, 0);
  EXPECT_EQ(Published(), 1);
}

TEST_F(StoreCommands, RollbackGoesToAnAncestor) {
  EXPECT_EQ(Run({"rollback", "3"}).code, 3);
  EXPECT_EQ(Run({"rollback", "3", "--dry-run"}).code, 3);
  EXPECT_EQ(Run({"rollback", "--dry-run", "--json"}).json()["published"], 1);
  EXPECT_EQ(Published(), 2);
  EXPECT_EQ(Run({"rollback"}).code, 0);
  EXPECT_EQ(Published(), 1);
  EXPECT_EQ(Run({"rollback"}).code, 3);
}

TEST_F(StoreCommands, ReportsSayWhyAPersonTookTheirRunOut) {
  ASSERT_EQ(Run({"runs", "hold", "--vehicle", "truck", "--reason", "new wheels"}).code, 0);
  EXPECT_THAT(Run({"reports"}).out, HasSubstr("1: its run is held (new wheels)"));
  EXPECT_EQ(Run({"reports", "--json"}).json()["reports"][0]["exclusion_reason"], "new wheels");
}

// The run of a report may have a UUID of its own.
TEST_F(StoreCommands, ReportsSayWhyTheirRunIsOut) {
  const Json report = Run({"reports", "--json"}).json()["reports"][0];
  ASSERT_EQ(Run({"runs", "exclude", report["uuid"], "--reason", "lies"}).code, 0);
  EXPECT_EQ(Run({"reports", "--json"}).json()["reports"][0]["exclusion_reason"], "lies");
}

// To exclude a name with a slip of the pen takes nothing out.
TEST_F(StoreCommands, AVehicleWithoutRunsIsNamed) {
  const Outcome slip = Run({"runs", "exclude", "--vehicle", "truk", "--reason", "lies"});
  EXPECT_EQ(slip.code, 0);
  EXPECT_THAT(slip.err, HasSubstr("no run of a vehicle 'truk' so far; did you mean 'truck'?"));
  EXPECT_THAT(Run({"runs", "exclude", "--vehicle", "truck", "--reason", "lies"}).err,
              Not(HasSubstr("no run of a vehicle")));
}

TEST_F(StoreCommands, ReportsSayWhichRowsCount) {
  const Json reports = Run({"reports", "--json"}).json()["reports"];
  ASSERT_EQ(reports.size(), 1U);
  EXPECT_EQ(reports[0]["evidence_rows"], 1);
  EXPECT_EQ(reports[0]["vehicle"], "truck");
  EXPECT_TRUE(reports[0]["set_aside"].empty());
  EXPECT_EQ(reports[0]["exclusion_reason"], nullptr);
  // To version 3 it came late: its visit began at that version's stamp.
  EXPECT_EQ(Run({"reports", "--version", "3"}).code, 0);
  const Json audit = Run({"audit", "--json"}, false).json()["audit"];
  EXPECT_EQ(audit.size(), 6U);
  EXPECT_EQ(audit.back()["action"], "return");
}

TEST_F(StoreCommands, VerifyBackupRestore) {
  const std::string backup = dir_.File("backup.db");
  EXPECT_THAT(Run({"verify"}, false).out, HasSubstr("all sound"));
  EXPECT_EQ(Run({"backup", "--output", backup, "--dry-run"}, false).code, 0);
  EXPECT_FALSE(std::filesystem::exists(backup));
  const Outcome made = Run({"backup", "--output", backup, "--json"}, false);
  ASSERT_EQ(made.code, 0) << made.err;
  ASSERT_EQ(Run({"rollback"}).code, 0);
  EXPECT_EQ(Run({"restore", backup}, false).code, 3);
  EXPECT_EQ(Run({"restore", backup, "--dry-run"}, false).code, 3);
  const Outcome restored = Run({"restore", backup, "--replace", "--json"}, false);
  ASSERT_EQ(restored.code, 0) << restored.err;
  EXPECT_EQ(restored.json()["digest"], made.json()["digest"]);
  EXPECT_EQ(restored.json()["backup_sha256"], made.json()["sha256"]);
  EXPECT_EQ(Published(), 2);
  EXPECT_TRUE(std::filesystem::exists(restored.json()["kept"].get<std::string>()));

  std::filesystem::resize_file(backup, std::filesystem::file_size(backup) / 2);
  EXPECT_EQ(RunAsIs({"verify", "--store", backup}).code, 3);
  EXPECT_EQ(Run({"restore", backup, "--replace"}, false).code, 3);
  EXPECT_EQ(Published(), 2);
}

TEST_F(StoreCommands, CompactAndMigrate) {
  const Outcome dry = Run({"compact", "--keep-versions", "1", "--dry-run", "--json"}, false);
  ASSERT_EQ(dry.code, 0) << dry.err;
  EXPECT_EQ(dry.json()["versions"], 1);
  EXPECT_EQ(Run({"show", "--version", "1"}).code, 0);
  EXPECT_EQ(Run({"compact", "--keep-versions", "1"}, false).code, 0);
  EXPECT_EQ(Run({"show", "--version", "1"}).code, 6);
  EXPECT_EQ(Run({"show"}).code, 0);
  EXPECT_EQ(Run({"compact", "--keep-versions", "0"}, false).code, 2);
  EXPECT_EQ(Run({"migrate"}, false).code, 5);
  EXPECT_EQ(RunAsIs({"migrate", "--store", dir_.File("missing")}).code, 6);
}

}  // namespace
}  // namespace shiftmap
