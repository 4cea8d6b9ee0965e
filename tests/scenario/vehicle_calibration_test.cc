// SPDX-License-Identifier: Apache-2.0
//
// Two vehicles whose odometry and sensors differ: what the nights find of each, and what a
// localizer gains from it.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <random>

#include "mapstore/codec/run_log.h"
#include "mapstore/geometry/angle.h"
#include "tests/scenario/command.h"
#include "tests/scenario/world.h"

namespace shiftmap::testing {
namespace {

// How a vehicle's log differs from one without systematic errors.
struct Vehicle {
  double scale_v;      // True over logged speed.
  double scale_omega;  // True over logged yaw rate.
  double bearing_offset_rad;
  double added_sd_range_m;
};

constexpr Vehicle kVehicles[] = {{1.05, 0.96, 0.05, 0.0}, {0.96, 1.03, -0.04, 0.15}};
constexpr double kSdRange = 0.05;  // Of the simulated sensor.
constexpr int kRuns = 6;           // The vehicles take turns.

void Distort(const std::string& path, const Vehicle& vehicle, std::mt19937_64* random) {
  StatusOr<RunLog> log = ReadRunLog(path);
  ASSERT_TRUE(log.ok()) << Message(log.status());
  for (OdometrySample& sample : log->run.odometry) {
    sample.v_mps /= vehicle.scale_v;
    sample.omega_radps /= vehicle.scale_omega;
  }
  std::normal_distribution<double> normal;
  for (Scan& scan : log->run.scans) {
    for (Observation& seen : scan.observations) {
      seen.z.x() = std::max(0.1, seen.z.x() + vehicle.added_sd_range_m * normal(*random));
      seen.z.y() = WrapAngle(seen.z.y() + vehicle.bearing_offset_rad);
    }
  }
  const Status written = WriteRunLog(log->run, path);
  ASSERT_TRUE(written.ok()) << Message(written);
}

class VehicleCalibrationTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    world_ = new World({"--shifts",
                        fmt::format("{}", kRuns),
                        "--duration-s",
                        "150",
                        "--groups",
                        "12",
                        "--size-m",
                        "16",
                        "--mode-change-probability",
                        "0.1",
                        "--range-sd-m",
                        fmt::format("{}", kSdRange),
                        "--seed",
                        "4"});
    std::mt19937_64 random(7);
    for (int run = 0; run < kRuns; ++run) Distort(world_->Log(run), kVehicles[run % 2], &random);
    // Night 1 has both vehicles, night 2 the first one only.
    Build("maps.db", {world_->Log(0), world_->Log(1)});
    Build("maps.db", {world_->Log(2)});
  }
  static void TearDownTestSuite() {
    delete world_;
    world_ = nullptr;
  }

  static Json Build(const std::string& store, const Arguments& words) {
    Arguments all = {"build", "--store", world_->File(store), "--area", "floor"};
    all.insert(all.end(), words.begin(), words.end());
    return RunForJson("shiftmap-mapper", all);
  }

  static Json Vehicles(const std::string& store, const std::string& version) {
    return RunForJson("shiftmap-inspect",
                      {"vehicles",
                       "--store",
                       world_->File(store),
                       "--area",
                       "floor",
                       "--version",
                       version})["vehicles"];
  }

  struct Drive {
    std::string calibration;
    double rmse_m;
    double nis;
  };

  // @param vehicle  Empty: as the log names it.
  static Drive Localize(int run, const std::string& vehicle) {
    const std::string path = world_->File("drive.tum");
    Arguments arguments = {"run",
                           "--store",
                           world_->File("maps.db"),
                           "--area",
                           "floor",
                           "--trajectory",
                           path,
                           world_->Log(run)};
    if (!vehicle.empty()) arguments.insert(arguments.end(), {"--vehicle", vehicle});
    const Json shift = RunForJson("shiftmap-localizer", arguments);
    const Json error =
        RunForJson("shiftmap-eval", {"trajectory", path, world_->Truth(run), "--align"});
    return {shift["calibration"], error["position_rmse_m"], shift["nis"]["mean"]};
  }

  static World* world_;
};

World* VehicleCalibrationTest::world_ = nullptr;

double Width(const Json& value) {
  return value["interval_95"][1].get<double>() - value["interval_95"][0].get<double>();
}

TEST_F(VehicleCalibrationTest, TheMapHasEachVehiclesOwn) {
  const Json vehicles = Vehicles("maps.db", "2");
  ASSERT_EQ(vehicles.size(), 2U);
  for (std::size_t v = 0; v < 2; ++v) {
    const Json& found = vehicles[v];
    const Vehicle& truth = kVehicles[v];
    EXPECT_EQ(found["vehicle"], fmt::format("vehicle-{}", v + 1));
    const auto expect_near = [&](const char* name, double value) {
      // Of ten intervals one or the other may miss the truth, but not by its own width.
      EXPECT_NEAR(found[name]["value"].get<double>(), value, Width(found[name])) << name;
    };
    expect_near("scale_v", truth.scale_v);
    expect_near("scale_omega", truth.scale_omega);
    expect_near("lag_s", 0.0);
    expect_near("bearing_offset_rad", truth.bearing_offset_rad);
    // And what the lengths of sensors differ by.
    const double sd_range = std::hypot(kSdRange, truth.added_sd_range_m);
    EXPECT_GT(found["sd_range_m"]["value"].get<double>(), sd_range);
    EXPECT_LT(found["sd_range_m"]["value"].get<double>(), sd_range + 0.1);
  }
}

TEST_F(VehicleCalibrationTest, ANightWithoutAVehicleKeepsWhatIsKnownOfIt) {
  const Json first = Vehicles("maps.db", "1");
  const Json second = Vehicles("maps.db", "2");
  EXPECT_EQ(first[1], second[1]);
  EXPECT_EQ(first[0]["runs"], 1);
  EXPECT_EQ(second[0]["runs"], 2);
  for (const char* name : {"scale_v", "scale_omega", "bearing_offset_rad", "sd_range_m"}) {
    EXPECT_LT(Width(second[0][name]), Width(first[0][name])) << name;
  }
}

TEST_F(VehicleCalibrationTest, LocalizesBetterThanTheFleets) {
  for (const int run : {4, 5}) {
    SCOPED_TRACE(run);
    const Drive own = Localize(run, "");
    const Drive fleet = Localize(run, "somebody-else");
    EXPECT_EQ(own.calibration, "vehicle");
    EXPECT_EQ(fleet.calibration, "fleet");
    RecordProperty(fmt::format("run_{}", run),
                   fmt::format("rmse {:.3f} m, nis {:.2f}; fleet's {:.3f} m, {:.2f}",
                               own.rmse_m,
                               own.nis,
                               fleet.rmse_m,
                               fleet.nis));
    // The second vehicle's noisier sensor leaves little to gain.
    EXPECT_LT(own.rmse_m, (run == 4 ? 0.8 : 1.05) * fleet.rmse_m);
    EXPECT_LT(own.nis, 2.5);
    // The fleet's calibration knows nothing of the first vehicle's good sensor.
    if (run == 4) {
      EXPECT_GT(own.nis, 1.5 * fleet.nis);
    }
  }
}

TEST_F(VehicleCalibrationTest, WithoutCalibrationNothingIsFoundAndNothingLost) {
  Build("off.db", {"--no-calibration", world_->Log(0)});
  EXPECT_TRUE(Vehicles("off.db", "1").empty());
  Build("on.db", {world_->Log(0), world_->Log(1)});
  Build("on.db", {"--no-calibration", world_->Log(2)});
  EXPECT_EQ(Vehicles("on.db", "1"), Vehicles("on.db", "2"));
}

TEST_F(VehicleCalibrationTest, ASnapshotCarriesIt) {
  const std::string snapshot = world_->File("snapshot.db");
  const Arguments area = {"--area", "floor", "--store"};
  const auto of = [&](const std::string& store, Arguments words) {
    words.insert(words.end(), area.begin(), area.end());
    words.push_back(store);
    return RunForJson("shiftmap-inspect", words);
  };
  of(world_->File("maps.db"), {"export", "--snapshot", "--output", snapshot});
  const Json shown = of(snapshot, {"show"});
  ASSERT_EQ(shown["vehicles"].size(), 2U);
  EXPECT_EQ(shown["vehicles"], Vehicles("maps.db", "2"));
  const Json diff = of(world_->File("maps.db"), {"diff", "1", "2"});
  EXPECT_TRUE(diff["vehicles_added"].empty());
  for (const Json& change : diff["calibration"]) EXPECT_NE(change["vehicle"], "vehicle-2");
}

}  // namespace
}  // namespace shiftmap::testing
