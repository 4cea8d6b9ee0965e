// SPDX-License-Identifier: Apache-2.0
//
// Simulated drives, whose logs are right, with one mistake put in at a time. Each must be found by
// its name, and nothing else; the right logs, and recorded ones, must be found right.
#include "tools/convert/check/motion_check.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <numbers>
#include <random>

#include "tests/unit/tools/convert/check/simulated_drive.h"
#include "tools/convert/utias.h"

namespace shiftmap {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;
using testing::SimulatedDrive;

std::vector<std::string> CodesOf(const Run& run) {
  MotionCheck check;
  testing::AddAll(run, &check);
  Findings findings;
  check.Report(&findings);
  std::vector<std::string> codes;
  for (const Finding& finding : findings) codes.push_back(finding.code);
  return codes;
}

void ForEachObservation(Run* run, const std::function<void(Observation&)>& change) {
  for (Scan& scan : run->scans) {
    for (Observation& observation : scan.observations) change(observation);
  }
}

// A sensor mounted at an angle that nobody told.
void TurnSensor(double angle_rad, Run* run) {
  ForEachObservation(run, [&](Observation& observation) { observation.z.y() += angle_rad; });
}

struct Mistake {
  std::string name;
  std::string code;
  std::function<void(Run*)> make;
};

const std::vector<Mistake>& Mistakes() {
  constexpr double kDegree = std::numbers::pi / 180.0;
  const auto for_odometry = [](double v, double omega) {
    return [v, omega](Run* run) {
      for (OdometrySample& sample : run->odometry) {
        sample.v_mps *= v;
        sample.omega_radps *= omega;
      }
    };
  };
  const auto for_z = [](double first, double second) {
    return [first, second](Run* run) {
      ForEachObservation(
          run, [&](Observation& o) { o.z = Eigen::Vector2d(first * o.z.x(), second * o.z.y()); });
    };
  };
  static const std::vector<Mistake> mistakes = {
      {"BearingClockwise", "bearing_sign", for_z(1.0, -1.0)},
      {"YawRateClockwise", "bearing_sign", for_odometry(1.0, -1.0)},
      {"SensorBackwards", "sensor_reversed", [](Run* run) { TurnSensor(std::numbers::pi, run); }},
      {"SpeedBackwards", "sensor_reversed", for_odometry(-1.0, 1.0)},
      {"BothBackwardsAndClockwise", "sensor_reversed_mirrored", for_odometry(-1.0, -1.0)},
      {"SensorLeft", "sensor_turned", [](Run* run) { TurnSensor(-0.5 * std::numbers::pi, run); }},
      {"SensorRight", "sensor_turned", [](Run* run) { TurnSensor(0.5 * std::numbers::pi, run); }},
      {"AxesSwapped",
       "axes_swapped",
       [](Run* run) {
         ForEachObservation(run, [](Observation& o) {
           const Eigen::Vector2d p = o.PositionInVehicle();
           o.kind = Observation::Kind::kCartesian;
           o.z = {p.y(), p.x()};
         });
       }},
      {"RangeMillimetres", "range_millimetres", for_z(1000.0, 1.0)},
      {"BearingDegrees", "bearing_degrees", for_z(1.0, 1.0 / kDegree)},
      {"YawRateDegrees", "yaw_rate_unit", for_odometry(1.0, 1.0 / kDegree)},
      {"SpeedMillimetres", "speed_unit", for_odometry(1000.0, 1.0)},
      {"SpeedKilometresPerHour", "speed_unit", for_odometry(3.6, 1.0)},
      {"SpeedMilesPerHour", "speed_unit", for_odometry(2.237, 1.0)},
      {"RangeFeet", "range_feet", for_z(3.281, 1.0)},
      {"YawRateHalf", "yaw_rate_scale", for_odometry(1.0, 0.5)},
      {"YawRateDouble", "yaw_rate_scale", for_odometry(1.0, 2.0)},
      {"BearingClockwiseInRowsWrittenTwice",
       "bearing_sign",
       [](Run* run) {
         for (Scan& scan : run->scans) {
           for (Observation& observation : scan.observations) observation.z.y() *= -1.0;
           const std::vector<Observation> rows = scan.observations;
           scan.observations.insert(scan.observations.end(), rows.begin(), rows.end());
         }
       }},
      {"OdometryZero", "odometry_frozen", for_odometry(0.0, 0.0)},
      {"YawRateZero", "yaw_rate_zero", for_odometry(1.0, 0.0)},
      {"DetectionsRepeated",
       "detections_frozen",
       [](Run* run) {
         Scan first;
         for (const Scan& scan : run->scans) {
           if (first.observations.size() < scan.observations.size()) first = scan;
         }
         for (Scan& scan : run->scans) scan.observations = first.observations;
       }},
      {"PositionsAtRandom",
       "motion_misfit",
       [](Run* run) {
         std::mt19937_64 random(3);
         std::uniform_real_distribution<double> range_m(1.0, 10.0);
         std::uniform_real_distribution<double> bearing_rad(-1.0, 1.0);
         ForEachObservation(run, [&](Observation& o) {
           o.z = {range_m(random), bearing_rad(random)};
         });
       }},
  };
  return mistakes;
}

class MistakeTest : public ::testing::TestWithParam<Mistake> {};

TEST_P(MistakeTest, IsFoundByItsName) {
  for (const std::uint64_t seed : {1U, 2U, 3U}) {
    shiftmap::Run run = SimulatedDrive(seed);
    GetParam().make(&run);
    EXPECT_THAT(CodesOf(run), ElementsAre(GetParam().code)) << "seed " << seed;
  }
}

INSTANTIATE_TEST_SUITE_P(Loggers,
                         MistakeTest,
                         ::testing::ValuesIn(Mistakes()),
                         [](const auto& test) { return test.param.name; });

TEST(MotionCheck, FindsRightLogsRight) {
  for (const std::uint64_t seed : {1U, 2U, 3U, 4U, 5U, 6U}) {
    EXPECT_THAT(CodesOf(SimulatedDrive(seed)), IsEmpty()) << "seed " << seed;
  }
}

TEST(MotionCheck, MovedLandmarksAndOutliersHideNoWrongSign) {
  shiftmap::Run run = SimulatedDrive(4);
  int i = 0;
  ForEachObservation(&run, [&](Observation& o) {
    o.z.y() = -o.z.y();
    // One in eight observations is nonsense.
    if (++i % 8 == 0) o.z = {1.0 + i % 13, 0.1 * (i % 31) - 1.5};
  });
  EXPECT_THAT(CodesOf(run), ElementsAre("bearing_sign"));
}

TEST(MotionCheck, StraightDrivesTellNoSign) {
  shiftmap::Run run;
  const Stamp begin = StampFromSeconds(1.8e9);
  for (int i = 0; i < 600; ++i) {
    const Stamp stamp = begin + FromSeconds(0.1 * i);
    run.odometry.push_back({stamp, 1.0, 0.0});
    Scan scan{stamp, {}};
    for (int landmark = 0; landmark < 15; ++landmark) {
      const Eigen::Vector2d p(4.0 * landmark - 0.1 * i, landmark % 2 == 0 ? 2.0 : -2.0);
      if (p.x() < 0.5 || p.x() > 10.0) continue;
      Observation observation;
      observation.signature = Signature("L" + std::to_string(landmark));
      observation.kind = Observation::Kind::kCartesian;
      observation.z = p;
      scan.observations.push_back(observation);
    }
    run.scans.push_back(scan);
  }
  EXPECT_THAT(CodesOf(run), ElementsAre("turns_few"));
  ForEachObservation(&run, [](Observation& o) { o.z.y() = -o.z.y(); });
  EXPECT_THAT(CodesOf(run), ElementsAre("turns_few"));
}

TEST(MotionCheck, KnowsRecordedRobotsToBeRightAndWrong) {
  const char* data = std::getenv("SHIFTMAP_DATA");
  const std::string folder = std::string(data == nullptr ? "" : data) + "/utias/MRCLAM_Dataset1";
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << "no UTIAS data: set SHIFTMAP_DATA";
  for (int robot = 1; robot <= 5; ++robot) {
    UtiasOptions options;
    options.dataset_dir = folder;
    options.robot = robot;
    if (!std::filesystem::exists(fmt::format("{}/Robot{}_Odometry.dat", folder, robot))) continue;
    const shiftmap::Run right = ReadUtias(options).value().run;
    EXPECT_THAT(CodesOf(right), IsEmpty()) << "robot " << robot;
    for (const Mistake& mistake : Mistakes()) {
      shiftmap::Run wrong = right;
      mistake.make(&wrong);
      EXPECT_THAT(CodesOf(wrong), ElementsAre(mistake.code)) << robot << " " << mistake.name;
    }
  }
}

}  // namespace
}  // namespace shiftmap
