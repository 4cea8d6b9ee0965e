// SPDX-License-Identifier: Apache-2.0
//
// A simulated shift, written as a bag of ROS 2 by foreign code (write_bag.mjs) in all forms that
// recorders have, and converted back: the run is the same, and so is the map made of it. Skipped
// where node or its packages are absent (tools/mcap_packages.sh).
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>

#include "mapstore/codec/run_log.h"
#include "tests/scenario/command.h"
#include "tests/scenario/world.h"
#include "tests/support/status_matchers.h"

namespace shiftmap::testing {
namespace {

namespace fs = std::filesystem;

// Stamps and velocities are exact; positions went through three rotations and back.
constexpr double kRoundingM = 1e-9;

// What an iterative solver makes of it.
constexpr double kSamePlaceM = 1e-5;

struct BagForm {
  std::string name;
  std::string storage = "mcap";
  std::string distro = "jazzy";
  std::string detections = "detection3d";
  std::string odometry = "odometry";
  std::string compression = "none";
  int split = 1;
  bool metadata = true;
  double sd_m = 0.0;
};

const World& Shifts() {
  static const World world(
      {"--shifts", "2", "--seed", "7", "--duration-s", "30", "--size-m", "20", "--groups", "12"});
  return world;
}

bool HasPackages() {
  for (const char* package :
       {"@mcap/core", "@foxglove/rosmsg2-serialization", "@foxglove/rosmsg-msgs-common", "lz4js"}) {
    if (!fs::exists(fs::path(SHIFTMAP_NODE_MODULES) / package)) return false;
  }
  return std::system("node --version > /dev/null 2>&1") == 0;
}

// Writes a run log as a bag in a folder beside it, once, and returns the folder.
std::string WriteBag(const BagForm& form, int run) {
  const std::string bag = Shifts().File(form.name + std::to_string(run));
  if (fs::exists(bag)) return bag;
  const Json spec = {{"input", Shifts().Log(run)},
                     {"output", bag},
                     {"storage", form.storage},
                     {"distro", form.distro},
                     {"detections", form.detections},
                     {"odometry", form.odometry},
                     {"compression", form.compression},
                     {"split", form.split},
                     {"metadata", form.metadata},
                     {"sd_m", form.sd_m}};
  const std::string command = fmt::format("SHIFTMAP_NODE_MODULES='{}' node '{}/write_bag.mjs' '{}'",
                                          SHIFTMAP_NODE_MODULES,
                                          SHIFTMAP_SCENARIO_DIR,
                                          spec.dump());
  EXPECT_EQ(std::system(command.c_str()), 0) << command;
  return bag;
}

Arguments Conversion(const std::string& bag, const std::string& output, int run = 0) {
  const std::string vehicle = ReadRunLog(Shifts().Log(run))->run.info.vehicle;
  return {"rosbag2", bag, "--output", output, "--vehicle", vehicle};
}

// How a kind of detections names a simulated landmark, whose name ends in its number.
std::string NameIn(const std::string& detections, const std::string& name) {
  const std::string number =
      std::to_string(std::stoi(name.substr(name.find_first_of("0123456789"))));
  if (detections == "fiducial") return number;
  return detections == "apriltag" ? "tag36h11:" + number : name;
}

void ExpectSameRun(const Run& original, const Run& converted, const std::string& detections) {
  ASSERT_EQ(converted.odometry.size(), original.odometry.size());
  for (std::size_t i = 0; i < original.odometry.size(); ++i) {
    ASSERT_EQ(converted.odometry[i].stamp, original.odometry[i].stamp) << i;
    ASSERT_EQ(converted.odometry[i].v_mps, original.odometry[i].v_mps) << i;
    ASSERT_EQ(converted.odometry[i].omega_radps, original.odometry[i].omega_radps) << i;
  }
  ASSERT_EQ(converted.scans.size(), original.scans.size());
  for (std::size_t i = 0; i < original.scans.size(); ++i) {
    ASSERT_EQ(converted.scans[i].stamp, original.scans[i].stamp) << i;
    const auto& expected = original.scans[i].observations;
    const auto& actual = converted.scans[i].observations;
    ASSERT_EQ(actual.size(), expected.size()) << i;
    for (std::size_t k = 0; k < expected.size(); ++k) {
      ASSERT_EQ(actual[k].signature.text(), NameIn(detections, expected[k].signature.text()));
      ASSERT_LT((actual[k].PositionInVehicle() - expected[k].PositionInVehicle()).norm(),
                kRoundingM)
          << i;
    }
  }
}

class Rosbag2Test : public ::testing::TestWithParam<BagForm> {
 protected:
  void SetUp() override {
    if (!HasPackages()) GTEST_SKIP() << "no node, or no packages in " << SHIFTMAP_NODE_MODULES;
  }
};

TEST_P(Rosbag2Test, GivesTheRunThatWasRecorded) {
  const BagForm& form = GetParam();
  const std::string bag = WriteBag(form, 0);
  const std::string output = bag + ".mcap";
  const Json report = RunForJson("shiftmap-convert", Conversion(bag, output));
  const bool defined = form.storage == "mcap" || form.distro != "humble";
  EXPECT_EQ(report["definitions"], defined ? "bag" : "built in");
  ExpectSameRun(ReadRunLog(Shifts().Log(0))->run, ReadRunLog(output)->run, form.detections);
  // A bag is only read.
  std::size_t files = 0;
  for (const auto& entry : fs::directory_iterator(bag)) {
    EXPECT_THAT(entry.path().string(), ::testing::Not(::testing::EndsWith("-shm")));
    ++files;
  }
  EXPECT_EQ(files, static_cast<std::size_t>(form.split) + (form.metadata ? 1 : 0));
}

INSTANTIATE_TEST_SUITE_P(
    Forms,
    Rosbag2Test,
    ::testing::Values(
        BagForm{.name = "mcap"},
        BagForm{.name = "mcap_zstd_chunks", .compression = "zstd_chunk"},
        BagForm{.name = "mcap_lz4_chunks", .odometry = "twist", .compression = "lz4_chunk"},
        BagForm{
            .name = "mcap_zstd_messages", .detections = "apriltag", .compression = "zstd_message"},
        BagForm{.name = "mcap_zstd_file", .compression = "zstd_file", .split = 2},
        BagForm{.name = "big_endian", .odometry = "twist_big_endian", .metadata = false},
        BagForm{.name = "db3_humble",
                .storage = "sqlite3",
                .distro = "humble",
                .compression = "zstd_message"},
        BagForm{.name = "db3_humble_fiducials",
                .storage = "sqlite3",
                .distro = "humble",
                .detections = "fiducial",
                .odometry = "twist",
                .compression = "zstd_file"},
        BagForm{.name = "db3_iron_split",
                .storage = "sqlite3",
                .distro = "iron",
                .detections = "apriltag",
                .split = 2,
                .metadata = false},
        BagForm{.name = "db3_jazzy", .storage = "sqlite3", .distro = "jazzy", .split = 3}),
    [](const auto& test) { return test.param.name; });

class Rosbag2OptionsTest : public Rosbag2Test {
 protected:
  const std::string bag_ = HasPackages() ? WriteBag({.name = "options", .sd_m = 0.2}, 0) : "";
  const std::string output_ = bag_ + ".mcap";

  void ExpectRefused(const Arguments& more, const std::string& object, int code = 3) const {
    Arguments arguments = Conversion(bag_, output_);
    arguments.insert(arguments.end(), more.begin(), more.end());
    ExpectError("shiftmap-convert", arguments, code, object);
  }
  shiftmap::Run Convert(const Arguments& more) const {
    Arguments arguments = Conversion(bag_, output_);
    arguments.insert(arguments.end(), more.begin(), more.end());
    RunForJson("shiftmap-convert", arguments);
    return ReadRunLog(output_)->run;
  }
};

INSTANTIATE_TEST_SUITE_P(One, Rosbag2OptionsTest, ::testing::Values(BagForm{.name = "one"}));

TEST_P(Rosbag2OptionsTest, TheSameBagGivesTheSameMap) {
  const BagForm form{.name = "for_map"};
  Arguments original = {"build", "--store", Shifts().File("original.db"), "--area", "floor"};
  Arguments converted = {"build", "--store", Shifts().File("converted.db"), "--area", "floor"};
  for (const int run : {0, 1}) {
    const std::string bag = WriteBag(form, run);
    RunForJson("shiftmap-convert", Conversion(bag, bag + ".mcap", run));
    original.push_back(Shifts().Log(run));
    converted.push_back(bag + ".mcap");
  }
  RunForJson("shiftmap-mapper", original);
  RunForJson("shiftmap-mapper", converted);
  const auto show = [](const std::string& store) {
    return RunForJson("shiftmap-inspect",
                      {"show", "--store", Shifts().File(store), "--area", "floor"});
  };
  const Json expected = show("original.db");
  const Json actual = show("converted.db");
  ASSERT_EQ(actual["groups"].size(), expected["groups"].size());
  ASSERT_GT(expected["groups"].size(), 8U);
  for (std::size_t g = 0; g < expected["groups"].size(); ++g) {
    const Json& group = expected["groups"][g];
    EXPECT_EQ(actual["groups"][g]["signature"], group["signature"]);
    ASSERT_EQ(actual["groups"][g]["modes"].size(), group["modes"].size());
    for (std::size_t m = 0; m < group["modes"].size(); ++m) {
      const Json& mode = group["modes"][m];
      if (mode["mode"] == 0) continue;
      for (const char* axis : {"x_m", "y_m"}) {
        EXPECT_NEAR(actual["groups"][g]["modes"][m][axis].get<double>(),
                    mode[axis].get<double>(),
                    kSamePlaceM);
      }
    }
  }
}

TEST_P(Rosbag2OptionsTest, CovariancesAreTheDetectionsOrAsToldToBe) {
  const auto first = [](const shiftmap::Run& run) {
    for (const Scan& scan : run.scans) {
      if (!scan.observations.empty()) return scan.observations.front();
    }
    return Observation();
  };
  const Observation projected = first(Convert({}));
  EXPECT_EQ(projected.kind, Observation::Kind::kCartesian);
  EXPECT_LT((*projected.cov_z - 0.04 * Eigen::Matrix2d::Identity()).norm(), 1e-12);
  const Observation fixed = first(Convert({"--covariance", "fixed", "--sd-m", "0.3"}));
  EXPECT_LT((*fixed.cov_z - 0.09 * Eigen::Matrix2d::Identity()).norm(), 1e-12);
  const Observation none = first(Convert({"--covariance", "none"}));
  EXPECT_EQ(none.kind, Observation::Kind::kRangeBearing);
  EXPECT_FALSE(none.cov_z.has_value());
}

TEST_P(Rosbag2OptionsTest, MountIsAsToldToBe) {
  // All positions turn about the sensor by half a circle, and move by half a metre.
  const shiftmap::Run forward =
      Convert({"--mount", "0,0,0,-1.5707963267948966,0,-1.5707963267948966"});
  const shiftmap::Run turned =
      Convert({"--mount", "0.5,0,0,-1.5707963267948966,0,1.5707963267948966"});
  for (std::size_t i = 0; i < forward.scans.size(); ++i) {
    for (std::size_t k = 0; k < forward.scans[i].observations.size(); ++k) {
      const Eigen::Vector2d p = forward.scans[i].observations[k].PositionInVehicle();
      const Eigen::Vector2d q = turned.scans[i].observations[k].PositionInVehicle();
      ASSERT_LT((q - Eigen::Vector2d(0.5 - p.x(), -p.y())).norm(), 1e-9);
    }
  }
}

TEST_P(Rosbag2OptionsTest, StampsAreHeadersUnlessLogTimeIsWanted) {
  const shiftmap::Run header = Convert({});
  const shiftmap::Run logged = Convert({"--stamps", "log"});
  ASSERT_EQ(logged.odometry.size(), header.odometry.size());
  EXPECT_EQ(logged.odometry[5].stamp - header.odometry[5].stamp, FromSeconds(0.005));
  EXPECT_EQ(logged.scans[5].stamp - header.scans[5].stamp, FromSeconds(0.090));
}

TEST_P(Rosbag2OptionsTest, SignatureIsOfTheFieldsThatAreNamed) {
  const shiftmap::Run run = Convert({"--signature", "{class_id}/{id}"});
  for (const Scan& scan : run.scans) {
    if (scan.observations.empty()) continue;
    EXPECT_THAT(scan.observations.front().signature.text(), ::testing::EndsWith("/track 0"));
    break;
  }
  ExpectRefused({"--signature", "{family}"}, "these detections have {class_id} {id}");
}

TEST_P(Rosbag2OptionsTest, NamesWhatThereIs) {
  ExpectRefused({"--odometry-topic", "/wheels"}, "there is '/odom' (nav_msgs/msg/Odometry)");
  ExpectRefused({"--detections-topic", "/odom"}, "there is '/detections'");
  ExpectRefused({"--vehicle-frame", "base_footprint"},
                "no fixed transforms lead from frame 'base_footprint' to 'camera_optical'",
                6);
  ExpectRefused({"--mount", "1,2"}, "expected X,Y,YAW", 2);
}

TEST_P(Rosbag2OptionsTest, ABagThatIsCutOffGivesItsBegin) {
  const std::string whole = bag_ + "/options0_0.mcap";
  const std::string cut = Shifts().File("cut.mcap");
  WriteFile(cut, ReadFile(whole).substr(0, fs::file_size(whole) / 2));
  const CommandResult result = RunCommand("shiftmap-convert", Conversion(cut, output_));
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_THAT(result.err, ::testing::HasSubstr("the file ends early"));
  const std::size_t samples = ReadRunLog(output_)->run.odometry.size();
  EXPECT_GT(samples, 100U);
  EXPECT_LT(samples, ReadRunLog(Shifts().Log(0))->run.odometry.size());
}

TEST_P(Rosbag2OptionsTest, RefusesWhatIsNoBag) {
  const auto refuse = [&](const std::string& bag, const std::string& object, int code) {
    ExpectError("shiftmap-convert", Conversion(bag, output_), code, object);
  };
  refuse(Shifts().File("nowhere"), "does not exist", 6);
  refuse(Shifts().Log(0), "no odometry", 3);  // A run log is MCAP too.
  const std::string folder = Shifts().File("empty_bag");
  fs::create_directory(folder);
  refuse(folder, "no .mcap or .db3 file", 6);
  WriteFile(folder + "/metadata.yaml", "rosbag2_bagfile_information: [");
  refuse(folder, "metadata.yaml", 3);
  WriteFile(folder + "/metadata.yaml",
            "rosbag2_bagfile_information:\n  relative_file_paths:\n    - a.db3\n");
  refuse(folder, "a.db3", 6);
  WriteFile(folder + "/a.db3", "SQLite format 3");
  refuse(folder, "a.db3", 3);
  const std::string text = Shifts().File("notes.txt");
  WriteFile(text, "hello");
  refuse(text, "expected a folder, a .mcap or .db3 file", 3);
}

}  // namespace
}  // namespace shiftmap::testing
