// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/LU>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <random>
#include <set>
#include <sstream>

#include "mapper/cli/commands.h"
#include "mapstore/codec/map_message.h"
#include "mapstore/map_store.h"
#include "mapstore/run/trajectory.h"
#include "tests/support/random_map.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tools/inspect/inspect_commands.h"

namespace shiftmap {
namespace {

using ::testing::HasSubstr;
using testing::IsOk;

// Would forge a line in a text format, a formula in a table, markup in a page.
constexpr const char* kHostile = "=1+1\n\x1b[2J<script>\"'\\,FIX 0\nVERTEX_XY 7 0 0";

RunRecord MakeRun(const std::string& name, char digit, Stamp end, int poses) {
  RunRecord run;
  run.name = name;
  run.sha256 = std::string(64, digit);
  run.vehicle = "vehicle-1";
  run.begin = end - FromSeconds(60.0);
  run.end = end;
  for (int i = 0; i < poses; ++i) {
    run.trajectory.push_back({run.begin + FromSeconds(0.5 * i), Se2(0.1 * i, 1.0 - i, 0.3 * i)});
  }
  return run;
}

// A store with a map that states its probabilities, made from three runs with odd names.
class ExportCommand : public ::testing::Test {
 protected:
  void SetUp() override {
    std::mt19937_64 random(testing::TestSeed(21));
    content_ = testing::RandomContent(random, {.groups = 8, .vehicles = 2});
    // Seconds hold it to the last bit.
    content_.stamp = StampFromNanoseconds(1'700'000'000'500'000'000);
    content_.groups.back().signature = Signature(kHostile);
    auto store = MapStore::Open(store_, MapStore::Access::kReadWriteCreate);
    ASSERT_THAT(store, IsOk());
    Provenance provenance;
    provenance.tool = "shiftmap-test 1";
    provenance.runs = {MakeRun("../evil\n", 'a', content_.stamp - FromSeconds(120.0), 4),
                       MakeRun("run_000", 'b', content_.stamp - FromSeconds(60.0), 7),
                       MakeRun("run_000", 'c', content_.stamp, 2),
                       MakeRun("bare", 'd', content_.stamp, 0)};
    ASSERT_THAT(store->Commit("hall", content_, provenance, {}), IsOk());
  }

  static int Run(Application* application, std::vector<std::string> arguments, std::string* out) {
    std::ostringstream output;
    std::ostringstream error;
    const ExitCode code = application->Run(arguments, &output, &error);
    *out = output.str() + error.str();
    return static_cast<int>(code);
  }

  int Export(const std::string& store, std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), "export");
    arguments.insert(arguments.end(), {"--store", store, "--area", "hall"});
    Application application("shiftmap-inspect", "");
    AddInspectCommands(&application);
    return Run(&application, arguments, &out_);
  }

  int Import(const std::string& store,
             const std::string& file,
             std::vector<std::string> more = {}) {
    more.insert(more.begin(), {"import", file, "--store", store, "--area", "hall"});
    Application application("shiftmap-mapper", "");
    AddImportCommand(&application);
    return Run(&application, more, &out_);
  }

  // Exports, imports into another store and exports again.
  std::pair<std::string, std::string> RoundTrip(const std::string& flag,
                                                const std::string& ending) {
    const std::vector<std::string> at = {"--at", "1700000000.5"};
    const std::string first = dir_.File("first" + ending);
    const std::string second = dir_.File("second" + ending);
    const std::string other = dir_.File("other" + ending + ".db");
    EXPECT_EQ(Export(store_, {flag, "--output", first, at[0], at[1]}), 0) << out_;
    EXPECT_EQ(Import(other, first, {"--stamp-s", at[1]}), 0) << out_;
    EXPECT_EQ(Export(other, {flag, "--output", second, at[0], at[1]}), 0) << out_;
    return {testing::ReadFile(first), testing::ReadFile(second)};
  }

  testing::TempDir dir_;
  std::string store_ = dir_.File("maps.db");
  MapContent content_;
  std::string out_;
};

TEST_F(ExportCommand, CsvComesBackEqual) {
  const auto [first, second] = RoundTrip("--csv", ".csv");
  EXPECT_EQ(first, second);
  EXPECT_THAT(first, HasSubstr("\n\"'=1+1\n"));
}

TEST_F(ExportCommand, GeoJsonComesBackEqualWithCovariancesAndRates) {
  const auto [first, second] = RoundTrip("--geojson", ".geojson");
  const Json a = Json::parse(first);
  const Json b = Json::parse(second);
  EXPECT_EQ(a["features"], b["features"]);
  EXPECT_EQ(a["stamp_s"], b["stamp_s"]);
  const Json& properties = a["features"][0]["properties"];
  const LandmarkGroup& first_group = content_.groups[0];
  EXPECT_EQ(properties["signature"], first_group.signature.text());
  EXPECT_EQ(properties["leave_rate_per_s"].get<double>(), first_group.chain.leave_rate_per_s());
  EXPECT_EQ(properties["cov_m2"][1].get<double>(), first_group.modes[0].cov_p_map_landmark(0, 1));
  EXPECT_THAT(first, ::testing::Not(HasSubstr("\x1b")));
}

// The whole map: joint covariance, calibrations and stamps too.
TEST_F(ExportCommand, ProtobufFormsComeBackEqual) {
  for (const auto& [flag, ending, form] : {std::tuple("--textproto", ".textproto", MapForm::kText),
                                           std::tuple("--protojson", ".protojson", MapForm::kJson),
                                           std::tuple("--protojson", ".json", MapForm::kJson)}) {
    const auto [first, second] = RoundTrip(flag, ending);
    const auto a = DecodeMap(first, form);
    const auto b = DecodeMap(second, form);
    ASSERT_THAT(a, IsOk());
    ASSERT_THAT(b, IsOk());
    EXPECT_EQ(ContentHash(a->content()), ContentHash(b->content()));
    EXPECT_EQ(GeometryHash(a->content()), GeometryHash(content_));
    EXPECT_EQ(first.find('\x1b'), std::string::npos);
  }
}

TEST_F(ExportCommand, G2oHoldsModesWithTheirInformationAndFixedPoses) {
  const std::string file = dir_.File("map.g2o");
  ASSERT_EQ(Export(store_, {"--g2o", "--output", file}), 0) << out_;
  std::istringstream lines(testing::ReadFile(file));
  std::map<int, Eigen::Vector2d> points;
  std::set<int> poses;
  std::set<int> fixed;
  std::vector<Eigen::Matrix2d> covariances;
  for (std::string line; std::getline(lines, line);) {
    std::istringstream in(line);
    std::string tag;
    int id = 0;
    in >> tag;
    if (tag == "#") continue;
    in >> id;
    Eigen::Vector2d p;
    Eigen::Matrix2d information;
    if (tag == "VERTEX_XY") {
      in >> p.x() >> p.y();
      EXPECT_TRUE(points.emplace(id, p).second) << line;
    } else if (tag == "EDGE_PRIOR_XY") {
      in >> p.x() >> p.y() >> information(0, 0) >> information(0, 1) >> information(1, 1);
      information(1, 0) = information(0, 1);
      EXPECT_EQ(p, points.at(id));
      covariances.push_back(information.inverse());
    } else if (tag == "VERTEX_SE2") {
      double yaw = 0.0;
      in >> p.x() >> p.y() >> yaw;
      EXPECT_TRUE(poses.insert(id).second && !points.contains(id)) << line;
    } else {
      EXPECT_EQ(tag, "FIX");
      fixed.insert(id);
    }
    EXPECT_TRUE(in) << line;
    EXPECT_TRUE((in >> std::ws).eof()) << line;
  }
  EXPECT_EQ(poses.size(), 13U);
  EXPECT_EQ(fixed, poses);
  std::size_t next = 0;
  for (const LandmarkGroup& group : content_.groups) {
    for (const Mode& mode : group.modes) {
      ASSERT_LT(next, covariances.size());
      EXPECT_TRUE(covariances[next].isApprox(mode.cov_p_map_landmark, 1e-9));
      EXPECT_EQ(points.at(static_cast<int>(next)), mode.p_map_landmark);
      ++next;
    }
  }
  EXPECT_EQ(points.size(), next + content_.anonymous_landmarks.size());
}

TEST_F(ExportCommand, TumHasAFilePerRunInsideTheFolder) {
  const std::string folder = dir_.File("tracks");
  ASSERT_EQ(Export(store_, {"--tum", "--output", folder, "--json"}), 0) << out_;
  std::set<std::string> names;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    names.insert(entry.path().filename());
  }
  EXPECT_EQ(names, (std::set<std::string>{"_.._evil_.tum", "run_000.tum", "run_000-2.tum"}));
  EXPECT_EQ(Json::parse(out_)["trajectories"].size(), 3U);
  const auto track = ReadTum(folder + "/run_000.tum");
  ASSERT_THAT(track, IsOk());
  ASSERT_EQ(track->size(), 7U);
  EXPECT_EQ((*track)[6].T_map_vehicle.x(), 0.1 * 6);
  EXPECT_NEAR((*track)[2].T_map_vehicle.yaw(), 0.6, 1e-12);
}

TEST_F(ExportCommand, TumOfOneRunIsOneFile) {
  const std::string file = dir_.File("one.tum");
  ASSERT_EQ(Export(store_, {"--tum", "--run", "ccc", "--output", file}), 0) << out_;
  EXPECT_EQ(ReadTum(file)->size(), 2U);
  EXPECT_EQ(Export(store_, {"--tum", "--run", "run_000", "--output", file}), 3);
  EXPECT_EQ(Export(store_, {"--tum", "--run", "run_9", "--output", file}), 6);
  EXPECT_EQ(Export(store_, {"--tum", "--run", "bare", "--output", file}), 6);
  EXPECT_EQ(Export(store_, {"--csv", "--run", "ccc", "--output", file}), 2);
}

TEST_F(ExportCommand, ADryRunWritesNothing) {
  for (const char* flag : {"--csv", "--g2o", "--tum", "--textproto", "--protojson", "--geojson"}) {
    EXPECT_EQ(Export(store_, {flag, "--dry-run", "--output", dir_.File("none")}), 0) << out_;
    EXPECT_FALSE(std::filesystem::exists(dir_.File("none"))) << flag;
  }
}

TEST_F(ExportCommand, StandardOutputIsNoFile) {
  EXPECT_EQ(Export(store_, {"--csv", "--output", "-"}), 2);
  EXPECT_FALSE(std::filesystem::exists("-"));
}

TEST_F(ExportCommand, AMapFileThatIsWrongIsRefusedWithThePlace) {
  const std::string file = dir_.File("map.geojson");
  ASSERT_EQ(Export(store_, {"--geojson", "--output", file}), 0);
  const Json good = Json::parse(testing::ReadFile(file));
  const std::string store = dir_.File("imported.db");
  const auto import = [&](const Json& document) {
    testing::WriteFile(file, document.dump());
    const int code = Import(store, file);
    EXPECT_FALSE(std::filesystem::exists(store));
    return code;
  };
  const auto with = [&](const char* pointer, const Json& value) {
    Json changed = good;
    changed[Json::json_pointer(pointer)] = value;
    return changed;
  };
  EXPECT_EQ(import(with("/coordinates", nullptr)), 3);
  EXPECT_THAT(out_, HasSubstr("degrees"));
  EXPECT_EQ(import(with("/features/1/properties/probability", 2.0)), 3);
  EXPECT_EQ(import(with("/features/1/properties/cov_m2/0", -1.0)), 3);
  EXPECT_EQ(import(with("/features/1/properties/cov_m2", "x")), 3);
  EXPECT_THAT(out_, HasSubstr("feature 1"));
  EXPECT_EQ(import(with("/features/1/properties/mode", 0)), 3);
  EXPECT_EQ(import(with("/features/1/properties/signature", 4)), 3);
  EXPECT_EQ(import(with("/features/1/properties/leave_rate_per_s", -1e-5)), 3);
  EXPECT_EQ(import(with("/features/1/geometry", nullptr)), 3);
  EXPECT_EQ(import(with("/features/1", Json::array())), 3);
  EXPECT_EQ(import(with("/features", Json::array())), 3);
  EXPECT_EQ(import(with("/stamp_s", 1e300)), 3);
  EXPECT_EQ(import(with("/stamp_s", 9.1e9)), 3);
  EXPECT_EQ(import(Json::array()), 3);
  testing::WriteFile(file, good.dump().substr(0, 200));
  EXPECT_EQ(Import(store, file), 3);
  for (const char* format : {"textproto", "protojson"}) {
    EXPECT_EQ(Import(store, file, {"--format", format}), 3);
  }
  EXPECT_EQ(Import(store, file, {"--format", "osm"}), 2);
}

}  // namespace
}  // namespace shiftmap
