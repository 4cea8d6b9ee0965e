// SPDX-License-Identifier: Apache-2.0
#include "tools/inspect/inspect_commands.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <random>
#include <sstream>

#include "mapstore/core/clock.h"
#include "mapstore/map_store.h"
#include "tests/support/random_map.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tools/eval/eval_commands.h"
#include "tools/inspect/map_export.h"

namespace shiftmap {
namespace {

using ::testing::HasSubstr;
using testing::IsOk;
using ::testing::StartsWith;

struct Outcome {
  int code;
  std::string out;
  std::string err;

  Json json() const { return Json::parse(out); }
};

// A store with two versions of one area, made from random content.
class InspectCommands : public ::testing::Test {
 protected:
  void SetUp() override {
    std::mt19937_64 random(testing::TestSeed(11));
    content_ = testing::RandomContent(random, {.groups = 6, .vehicles = 2});
    auto store = MapStore::Open(store_, MapStore::Access::kReadWriteCreate);
    ASSERT_THAT(store, IsOk());
    Provenance provenance;
    provenance.tool = "shiftmap-test 1";
    RunRecord run;
    run.name = "run_000";
    run.sha256 = std::string(64, 'a');
    run.vehicle = "vehicle-1";
    run.begin = content_.stamp - FromSeconds(60.0);
    run.end = content_.stamp;
    run.trajectory = {{run.begin, Se2()}, {run.end, Se2(3.0, 4.0, 0.5)}};
    provenance.runs.push_back(run);
    const auto first = store->Commit("hall", content_, provenance, {});
    ASSERT_THAT(first, IsOk());
    const auto second =
        store->Commit("hall", content_, provenance, {.parent = first->version, .publish = true});
    ASSERT_THAT(second, IsOk());
    content_hash_ = second->content_hash;
  }

  Outcome Run(std::vector<std::string> arguments, bool with_area = true) {
    arguments.insert(arguments.end(), {"--store", store_});
    if (with_area) arguments.insert(arguments.end(), {"--area", "hall"});
    Application application("shiftmap-inspect", "");
    AddInspectCommands(&application);
    std::ostringstream out;
    std::ostringstream err;
    const ExitCode code = application.Run(arguments, &out, &err);
    return {static_cast<int>(code), out.str(), err.str()};
  }

  testing::TempDir dir_;
  std::string store_ = dir_.File("maps.db");
  MapContent content_;
  std::string content_hash_;
};

TEST_F(InspectCommands, ListsAreasAndVersions) {
  const Outcome areas = Run({"areas", "--json"}, false);
  ASSERT_EQ(areas.code, 0) << areas.err;
  EXPECT_EQ(areas.json()["areas"],
            Json::parse(R"([{"area": "hall", "published": 2, "versions": 2}])"));
  const Outcome versions = Run({"versions", "--json"});
  ASSERT_EQ(versions.code, 0) << versions.err;
  const Json list = versions.json()["versions"];
  ASSERT_EQ(list.size(), 2U);
  EXPECT_EQ(list[0]["parent"], nullptr);
  EXPECT_EQ(list[0]["published"], false);
  EXPECT_EQ(list[1]["version"], 2);
  EXPECT_EQ(list[1]["parent"], 1);
  EXPECT_EQ(list[1]["published"], true);
  EXPECT_EQ(list[1]["content_hash"], content_hash_);
  EXPECT_GT(list[1]["created_s"].get<double>(), 1.6e9);
}

TEST_F(InspectCommands, ShowsAMapBitByBit) {
  // At the map's own time, or a little before.
  const double at_s = std::floor(ToSecondsSinceEpoch(content_.stamp));
  const Outcome outcome = Run({"show", "--json", "--at", fmt::format("{}", at_s)});
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  const Json map = outcome.json();
  EXPECT_EQ(map["area"], "hall");
  EXPECT_EQ(map["version"], 2);
  EXPECT_EQ(map["parent"], 1);
  EXPECT_EQ(map["content_hash"], content_hash_);
  EXPECT_EQ(map["anonymous_landmarks"], content_.anonymous_landmarks.size());
  ASSERT_EQ(map["groups"].size(), content_.groups.size());
  for (std::size_t g = 0; g < content_.groups.size(); ++g) {
    const LandmarkGroup& group = content_.groups[g];
    const Json& shown = map["groups"][g];
    EXPECT_EQ(shown["signature"], group.signature.text());
    ASSERT_EQ(shown["modes"].size(), group.modes.size() + 1);
    EXPECT_EQ(shown["modes"][0]["mode"], 0);
    EXPECT_FALSE(shown["modes"][0].contains("x_m"));
    for (std::size_t i = 0; i < group.modes.size(); ++i) {
      const Json& mode = shown["modes"][i + 1];
      EXPECT_EQ(mode["mode"], group.modes[i].number.value());
      EXPECT_EQ(mode["x_m"].get<double>(), group.modes[i].p_map_landmark.x());
      EXPECT_EQ(mode["cov_m2"][1].get<double>(), group.modes[i].cov_p_map_landmark(0, 1));
      EXPECT_NEAR(mode["probability"].get<double>(),
                  group.probabilities(static_cast<Eigen::Index>(i + 1)),
                  1e-12);
    }
  }
}

TEST_F(InspectCommands, ListsVehiclesWithIntervals) {
  const Outcome outcome = Run({"vehicles", "--json"});
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  const Json vehicles = outcome.json()["vehicles"];
  ASSERT_EQ(vehicles.size(), 2U);
  const VehicleCalibration& expected = content_.vehicles[1];
  EXPECT_EQ(vehicles[1]["vehicle"], "truck-1");
  EXPECT_EQ(vehicles[1]["runs"], expected.runs);
  const Json& scale = vehicles[1]["scale_v"];
  EXPECT_NEAR(scale["value"].get<double>(), std::exp(expected.log_scale_v.value), 1e-12);
  EXPECT_NEAR(scale["interval_95"][0].get<double>(),
              std::exp(expected.log_scale_v.value - 1.959964 * expected.log_scale_v.sd),
              1e-9);
  EXPECT_EQ(Run({"show", "--json"}).json()["vehicles"], vehicles);
  EXPECT_THAT(Run({"vehicles"}).out, HasSubstr("bearing_offset_rad"));
}

TEST_F(InspectCommands, AtATimeTheChainsAreRunToIt) {
  const double later = ToSecondsSinceEpoch(content_.stamp) + 1e9;
  const Outcome outcome =
      Run({"show", "--json", "--version", "1", "--at", fmt::format("{}", later)});
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_EQ(outcome.json()["version"], 1);
  const Json modes = outcome.json()["groups"][0]["modes"];
  const LandmarkGroup& group = content_.groups[0];
  const Eigen::VectorXd expected = group.chain.Propagate(group.probabilities, FromSeconds(1e9));
  for (Eigen::Index i = 0; i < expected.size(); ++i) {
    EXPECT_NEAR(modes[static_cast<std::size_t>(i)]["probability"].get<double>(), expected(i), 1e-9);
  }
}

TEST_F(InspectCommands, ATimeBeforeTheVersionIsAnsweredWithAWarning) {
  const double stamp = ToSecondsSinceEpoch(content_.stamp);
  const std::string signature = content_.groups[0].signature.text();
  for (const std::vector<std::string>& command :
       {std::vector<std::string>{"show"}, {"modes"}, {"history", signature}}) {
    std::vector<std::string> arguments = command;
    arguments.insert(arguments.end(), {"--at", fmt::format("{:.3f}", stamp - 3600.0)});
    const Outcome earlier = Run(arguments);
    ASSERT_EQ(earlier.code, 0) << earlier.err;
    EXPECT_THAT(earlier.err, HasSubstr("the version tells of no time before 2023-11-14 22:13:20"));
    // As precise as `show --json` prints it, which is no earlier time.
    arguments.back() = fmt::format("{:.6f}", stamp);
    EXPECT_EQ(Run(arguments).err, "");
  }
}

TEST_F(InspectCommands, WithoutATimeTheyAreRunToNow) {
  const double before_s = ToSecondsSinceEpoch(SystemNow());
  const Json map = Run({"show", "--json"}).json();
  EXPECT_GE(map["stamp_s"].get<double>(), before_s - 1e-3);
  EXPECT_LE(map["stamp_s"].get<double>(), ToSecondsSinceEpoch(SystemNow()) + 1e-3);
  const LandmarkGroup& group = content_.groups[0];
  const Eigen::VectorXd expected =
      group.chain.Propagate(group.probabilities, StampFromSeconds(map["stamp_s"]) - content_.stamp);
  const Json modes = Run({"modes", group.signature.text(), "--json"}).json()["modes"];
  for (Eigen::Index i = 0; i < expected.size(); ++i) {
    const auto state = static_cast<std::size_t>(i);
    EXPECT_NEAR(map["groups"][0]["modes"][state]["probability"].get<double>(), expected(i), 1e-6);
    if (i == 0) continue;
    EXPECT_NEAR(modes[state - 1]["probability"].get<double>(), expected(i), 1e-5);
  }
}

TEST_F(InspectCommands, TextHasALinePerMode) {
  const Outcome outcome = Run({"modes"});
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  std::size_t modes = 0;
  for (const LandmarkGroup& group : content_.groups) modes += group.modes.size();
  const auto lines = std::count(outcome.out.begin(), outcome.out.end(), '\n');
  EXPECT_EQ(static_cast<std::size_t>(lines), 1 + modes);
  EXPECT_EQ(Run({"show"}).code, 0);
  EXPECT_EQ(Run({"sightings"}).code, 0);
}

// Both versions are made from the one run.
TEST_F(InspectCommands, ARunOfALineIsListedOnce) {
  const Json own = Run({"runs", "--json"}).json()["runs"];
  ASSERT_EQ(own.size(), 1U);
  EXPECT_EQ(own[0]["run"], "run_000");
  EXPECT_EQ(own[0]["version"], 2);
  const Json all = Run({"runs", "--all", "--json"}).json()["runs"];
  ASSERT_EQ(all.size(), 1U);
  EXPECT_EQ(all[0]["run"], "run_000");
  EXPECT_EQ(all[0]["version"], 1);
}

// What a build has mapped since is no events, unless one asks for it.
TEST_F(InspectCommands, SightingsAreThoseThatNoModeExplains) {
  const LandmarkGroup& group = content_.groups[2];
  UnmappedSighting mapped;
  mapped.signature = group.signature;
  mapped.p_map_landmark = group.modes[0].p_map_landmark + Eigen::Vector2d(0.2, -0.1);
  mapped.cov_p_map_landmark = 0.01 * Eigen::Matrix2d::Identity();
  mapped.count = 3;
  mapped.first = mapped.last = content_.stamp;
  UnmappedSighting stray = mapped;
  stray.p_map_landmark += Eigen::Vector2d(1000.0, 0.0);
  UnmappedSighting other = mapped;  // Another landmark at that place.
  other.signature = Signature("nobody knows it");
  ShiftReport report;
  report.uuid = "0f8fad5b-d9cb-469f-a165-70867728950e";
  report.vehicle = "truck-1";
  report.area = "hall";
  report.version = VersionNumber(2);
  report.content_hash = content_hash_;
  report.software = "test";
  report.begin = report.end = content_.stamp;
  report.sightings = {mapped, stray, other};
  ASSERT_THAT(MapStore::Open(store_, MapStore::Access::kReadWrite)->Return(report), IsOk());
  const Json news = Run({"sightings", "--json"}).json()["sightings"];
  ASSERT_EQ(news.size(), 2U);
  for (const Json& sighting : news) {
    EXPECT_TRUE(sighting["x_m"] > 900.0 || sighting["signature"] == other.signature.text());
  }
  EXPECT_EQ(Run({"sightings", "--all", "--json"}).json()["sightings"].size(), 3U);
}

TEST_F(InspectCommands, HistoryOfALandmark) {
  const std::string signature = content_.groups[2].signature.text();
  const Outcome outcome = Run({"history", signature, "--json"});
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  const Json history = outcome.json()["history"];
  ASSERT_GE(history.size(), 1U);
  EXPECT_NEAR(
      history[0]["probabilities"]["0"].get<double>(), content_.groups[2].probabilities(0), 1e-12);
  EXPECT_EQ(Run({"history", "no such landmark"}).code, 6);
}

TEST_F(InspectCommands, ExportsGeoJsonAndCsv) {
  const std::string output = dir_.File("map.out");
  ASSERT_EQ(Run({"export", "--geojson", "--output", output}).code, 0);
  const Json collection = Json::parse(testing::ReadFile(output));
  EXPECT_EQ(collection["type"], "FeatureCollection");
  std::size_t modes = 0;
  for (const LandmarkGroup& group : content_.groups) modes += group.modes.size();
  EXPECT_EQ(collection["features"].size(), modes + content_.anonymous_landmarks.size());
  EXPECT_EQ(collection["features"][0]["geometry"]["coordinates"][0].get<double>(),
            content_.groups[0].modes[0].p_map_landmark.x());
  ASSERT_EQ(Run({"export", "--csv", "--output", output}).code, 0);
  EXPECT_THAT(testing::ReadFile(output),
              StartsWith("signature,mode,x_m,y_m,sd_x_m,sd_y_m,probability\n"));
}

TEST_F(InspectCommands, AnExportedSnapshotIsAStoreOfItsOwn) {
  const std::string output = dir_.File("snapshot.db");
  ASSERT_EQ(Run({"export", "--snapshot", "--output", output}).code, 0);
  store_ = output;
  EXPECT_EQ(Run({"show", "--json"}).json()["content_hash"], content_hash_);
}

TEST_F(InspectCommands, ADryRunWritesNothing) {
  const std::string output = dir_.File("map.svg");
  EXPECT_EQ(Run({"plot", "map", "--dry-run", "--output", output}).code, 0);
  EXPECT_FALSE(std::filesystem::exists(output));
  EXPECT_EQ(Run({"plot", "--output", output}).code, 0);
  EXPECT_THAT(testing::ReadFile(output), HasSubstr("run_000"));
}

TEST_F(InspectCommands, TheEndingSaysTheFormatOfAPicture) {
  const std::string png = dir_.File("map.PNG");
  ASSERT_EQ(Run({"plot", "map", "--output", png, "--width-px", "300"}).code, 0);
  EXPECT_THAT(testing::ReadFile(png), StartsWith("\x89PNG\r\n\x1a\n"));
  const std::string svg = dir_.File("map.svg");
  ASSERT_EQ(Run({"plot", "map", "--output", svg}).code, 0);
  EXPECT_THAT(testing::ReadFile(svg), StartsWith("<?xml"));
  for (const char* name : {"map", "map.jpg", "map.svg.gz", ".png.txt"}) {
    const Outcome outcome = Run({"plot", "map", "--output", dir_.File(name)});
    EXPECT_EQ(outcome.code, 2) << name;
    EXPECT_THAT(outcome.err, HasSubstr("expected a name that ends in .svg or .png"));
    EXPECT_FALSE(std::filesystem::exists(dir_.File(name)));
  }
  EXPECT_EQ(Run({"plot", "map", "--output", svg, "--width-px", "300"}).code, 2);
}

TEST_F(InspectCommands, DrawsEveryKindOfPictureOfAMap) {
  const std::string signature = content_.groups[0].signature.text();
  const std::string output = dir_.File("picture.svg");
  for (const std::vector<std::string>& words :
       std::vector<std::vector<std::string>>{{"map"},
                                             {"modes", signature},
                                             {"history", signature},
                                             {"diff", "1", "2"},
                                             {"rates"},
                                             {"night"}}) {
    std::vector<std::string> all = {"plot", "--json", "--output", output};
    all.insert(all.begin() + 1, words.begin(), words.end());
    const Outcome outcome = Run(all);
    ASSERT_EQ(outcome.code, 0) << words[0] << ": " << outcome.err;
    EXPECT_EQ(outcome.json()["picture"], words[0]);
    EXPECT_EQ(outcome.json()["bytes"], testing::ReadFile(output).size());
    EXPECT_THAT(testing::ReadFile(output), StartsWith("<?xml"));
  }
}

TEST_F(InspectCommands, PicturesNameWhatIsMissing) {
  const std::string output = dir_.File("a.svg");
  const auto expect = [&](std::vector<std::string> words, int code, const std::string& what) {
    words.insert(words.begin(), "plot");
    words.insert(words.end(), {"--output", output});
    const Outcome outcome = Run(words);
    EXPECT_EQ(outcome.code, code) << outcome.err;
    EXPECT_THAT(outcome.err, HasSubstr(what));
    EXPECT_FALSE(std::filesystem::exists(output));
  };
  expect({"modes"}, 2, "expected a signature");
  expect({"modes", "nowhere"}, 6, "no landmark 'nowhere'");
  expect({"history", "nowhere"}, 6, "nowhere");
  expect({"diff", "1"}, 2, "expected two versions");
  expect({"diff", "1", "x"}, 2, "expected two versions");
  expect({"diff", "1", "9"}, 6, "9");
  expect({"map", "L01"}, 2, "expected nothing more");
  expect({"map", "--truth", "t.tum"}, 2, "--truth is for trajectory and consistency");
  expect({"trajectory", "a.tum", "--align"}, 2, "--align is for --truth");
  expect({"trajectory", dir_.File("none.tum")}, 6, "none.tum");
  std::ofstream(dir_.File("empty.tum")).flush();
  expect({"trajectory", dir_.File("empty.tum")}, 3, "empty.tum': no pose");
  expect({"consistency", dir_.File("none.csv")}, 6, "none.csv");
}

TEST_F(InspectCommands, ErrorsHaveTheirExitCodes) {
  EXPECT_EQ(Run({"show", "--version", "9"}).code, 6);
  EXPECT_EQ(Run({"export", "--output", dir_.File("a")}).code, 2);
  EXPECT_EQ(Run({"export", "--csv", "--geojson", "--output", dir_.File("a")}).code, 2);
  EXPECT_EQ(Run({"plot", "nothing", "--output", dir_.File("a.svg")}).code, 2);
  store_ = dir_.File("none.db");
  EXPECT_EQ(Run({"show"}).code, 6);
  testing::WriteFile(store_, "this is not a database, whatever its name says\n");
  EXPECT_EQ(Run({"show"}).code, 3);
}

TEST_F(InspectCommands, WithoutAnAreaTheyNameThoseOfTheStore) {
  for (const char* command : {"show", "versions", "runs", "vehicles"}) {
    const Outcome outcome = Run({command}, false);
    EXPECT_EQ(outcome.code, 2) << command;
    EXPECT_THAT(outcome.err, HasSubstr("--area is required, one of 'hall'")) << command;
  }
  const Outcome plot = Run({"plot", "map", "--output", dir_.File("a.svg")}, false);
  EXPECT_EQ(plot.code, 2);
  EXPECT_THAT(plot.err, HasSubstr("--area is required, one of 'hall'"));
  store_ = dir_.File("none.db");
  EXPECT_THAT(Run({"show"}, false).err, HasSubstr("--area is required; try"));
}

TEST_F(InspectCommands, AnEmptyListSaysSo) {
  EXPECT_EQ(Run({"reports"}).out, "no reports\n");
  EXPECT_EQ(Run({"sightings"}).out, "no sightings that the map does not explain\n");
  EXPECT_EQ(Run({"edit", "list"}).out, "no edits\n");
  store_ = dir_.File("empty.db");
  ASSERT_THAT(MapStore::Open(store_, MapStore::Access::kReadWriteCreate), IsOk());
  EXPECT_EQ(Run({"areas"}, false).out, "no areas\n");
}

TEST_F(InspectCommands, EvaluatesAMapAgainstItsOwnExport) {
  const std::string truth = dir_.File("truth.csv");
  ASSERT_EQ(Run({"export", "--csv", "--output", truth}).code, 0);
  Application application("shiftmap-eval", "");
  AddEvalCommands(&application);
  std::ostringstream out;
  std::ostringstream err;
  const ExitCode code = application.Run(
      {"map", "--store", store_, "--area", "hall", truth, "--no-align", "--json"}, &out, &err);
  ASSERT_EQ(code, ExitCode::kDone) << err.str();
  EXPECT_EQ(Json::parse(out.str())["max_m"].get<double>(), 0.0);
}

// A store whose names would move a terminal's cursor and forge a row.
class HostileNames : public InspectCommands {
 protected:
  void SetUp() override {
    auto store = MapStore::Open(store_, MapStore::Access::kReadWriteCreate);
    ASSERT_THAT(store, IsOk());
    std::mt19937_64 random(testing::TestSeed(12));
    content_ = testing::RandomContent(random, {.groups = 1, .vehicles = 1});
    content_.groups[0].signature = Signature(kName);
    content_.vehicles[0].vehicle = kName;
    Provenance provenance;
    provenance.tool = kName;
    RunRecord run;
    run.name = kName;
    run.sha256 = std::string(64, 'a');
    run.vehicle = kName;
    run.begin = run.end = content_.stamp;
    provenance.runs.push_back(run);
    const auto version = store->Commit(kName, content_, provenance, {});
    ASSERT_THAT(version, IsOk());
    const auto second = store->Commit(kName, content_, provenance, {.parent = version->version});
    ASSERT_THAT(second, IsOk());
    ShiftReport report;
    report.uuid = "00000000-0000-4000-8000-000000000001";
    report.software = kName;
    report.vehicle = kName;
    report.area = kName;
    report.version = version->version;
    report.content_hash = version->content_hash;
    report.begin = report.end = content_.stamp;
    UnmappedSighting sighting;
    sighting.signature = Signature(kName);
    sighting.count = 1;
    sighting.first = sighting.last = content_.stamp;
    sighting.cov_p_map_landmark = Eigen::Matrix2d::Identity();
    report.sightings.push_back(sighting);
    ASSERT_THAT(store->Return(report), IsOk());
  }

  static constexpr const char* kName =
      "\x1b[1A\x1b[2K\x07\r\n2026-01-09 08:01:00  honest  1  0\xc2\x9b"
      "K\xe2\x80\xae";
};

TEST_F(HostileNames, NothingThatIsPrintedIsObeyed) {
  const std::string picture = dir_.File("a\x1b.svg");
  const std::vector<std::vector<std::string>> commands = {
      {"areas"},
      {"versions", "--area", kName},
      {"runs", "--area", kName},
      {"sightings", "--area", kName},
      {"reports", "--area", kName},
      {"audit"},
      {"show", "--area", kName},
      {"modes", "--area", kName},
      {"history", "--area", kName, "--", kName},
      {"vehicles", "--area", kName},
      {"diff", "1", "2", "--area", kName},
      {"plot", "--area", kName, "--output", picture},
      {"rollback", "--area", kName},
      {"publish", "2", "--area", kName},
      // Errors.
      {"show", "--area", std::string(kName) + "x"},
      {"modes", "--area", kName, "--", std::string(kName) + "x"},
      {"show", "--area", kName, "--version", "9"},
      {"show", "--area", kName, std::string("--") + kName},
  };
  for (std::vector<std::string> words : commands) {
    SCOPED_TRACE(words[0]);
    words.insert(words.begin() + 1, {"--store", store_});
    for (const bool json : {false, true}) {
      std::vector<std::string> all = words;
      if (json) all.insert(all.begin() + 1, "--json");
      Application application("shiftmap-inspect", "");
      AddInspectCommands(&application);
      std::ostringstream out;
      std::ostringstream err;
      application.Run(all, &out, &err);
      for (const std::string& text : {out.str(), err.str()}) {
        for (const char* active : {"\x1b", "\x07", "\r", "\xc2\x9b", "\xe2\x80\xae"}) {
          EXPECT_EQ(text.find(active), std::string::npos) << text;
        }
        EXPECT_EQ(text.find("\n2026-01-09 08:01:00  honest"), std::string::npos) << text;
      }
      EXPECT_FALSE(out.str().empty() && err.str().empty());
    }
  }
}

TEST(MapCsv, QuotesWhatWouldBreakARow) {
  MapContent content;
  LandmarkGroup group;
  group.signature = Signature("a,\"b\"");
  group.modes.push_back({ModeNumber(1), {1.0, 2.0}, Eigen::Matrix2d::Identity(), Stamp()});
  group.probabilities = Eigen::Vector2d(0.25, 0.75);
  group.chain = ModeChain::Uniform(1, 0.0);
  content.groups.push_back(group);
  content.covariance = JointCovariance({Eigen::Matrix2d::Identity()}, {});
  const MapSnapshot map("hall", VersionNumber(1), "hash", content);
  EXPECT_THAT(MapCsv(map), HasSubstr("\n\"a,\"\"b\"\"\",1,1,2,1,1,0.75\n"));
}

}  // namespace
}  // namespace shiftmap
