// SPDX-License-Identifier: Apache-2.0
//
// Runs that are valid and make no sense: a build gives a valid map, or says what is wrong.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <functional>
#include <numbers>
#include <optional>
#include <random>
#include <vector>

#include "mapper/mapper.h"
#include "mapper/modes/unconstrained_runs.h"
#include "mapstore/geometry/se2.h"
#include "mapstore/map/map_snapshot.h"
#include "tests/support/random_map.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/mapper/mapper_test_util.h"

namespace shiftmap {
namespace {

class OddRuns {
 public:
  explicit OddRuns(std::uint64_t seed) : random_(seed) {}

  // Changes a run in one of many ways.
  void Change(shiftmap::Run* run) {
    using Way = void (OddRuns::*)(shiftmap::Run*);
    constexpr Way kWays[] = {&OddRuns::WildSightings,
                             &OddRuns::WildOdometry,
                             &OddRuns::Cartesian,
                             &OddRuns::WildCovariances,
                             &OddRuns::OneSignature,
                             &OddRuns::Jump,
                             &OddRuns::OneStamp,
                             &OddRuns::CutShort,
                             &OddRuns::StandStill,
                             &OddRuns::ScansAtAnotherTime,
                             &OddRuns::AllInALine};
    (this->*kWays[Below(std::size(kWays))])(run);
  }

  std::size_t Below(std::size_t n) { return random_() % n; }

 private:
  double Uniform(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random_);
  }

  // Of either sign and any order of magnitude that logs may have.
  double Wild(double low = -9.0, double high = 8.9) {
    const double size = std::pow(10.0, Uniform(low, high));
    return Below(2) == 0 ? size : -size;
  }

  void ForSome(shiftmap::Run* run, const std::function<void(Observation*)>& change) {
    const double share = std::pow(10.0, Uniform(-2.5, 0.0));
    for (Scan& scan : run->scans) {
      for (Observation& observation : scan.observations) {
        if (Uniform(0.0, 1.0) < share) change(&observation);
      }
    }
  }

  void WildSightings(shiftmap::Run* run) {
    ForSome(run, [&](Observation* o) {
      o->z.x() = std::abs(Wild());
      o->z.y() = Wild(-3.0);
    });
  }

  void WildOdometry(shiftmap::Run* run) {
    for (OdometrySample& sample : run->odometry) {
      if (Below(20) != 0) continue;
      sample.v_mps = Wild();
      sample.omega_radps = Wild();
    }
  }

  void Cartesian(shiftmap::Run* run) {
    ForSome(run, [&](Observation* o) {
      o->kind = Observation::Kind::kCartesian;
      o->z.x() = Wild();
      o->z.y() = Wild();
    });
  }

  void WildCovariances(shiftmap::Run* run) {
    ForSome(run, [&](Observation* o) {
      Eigen::Matrix2d cov = Eigen::Matrix2d::Zero();
      cov(0, 0) = std::abs(Wild(-17.0, 17.0));
      cov(1, 1) = std::abs(Wild(-17.0, 17.0));
      o->cov_z = cov;
    });
  }

  void OneSignature(shiftmap::Run* run) {
    const Signature one = run->scans.back().observations.empty()
                              ? Signature("L1")
                              : run->scans.back().observations.front().signature;
    ForSome(run, [&](Observation* o) { o->signature = one; });
  }

  void Jump(shiftmap::Run* run) {
    const Duration jump = FromSeconds(std::abs(Wild(0.0, 8.9)));
    const Stamp at = run->odometry[Below(run->odometry.size())].stamp;
    for (OdometrySample& sample : run->odometry) {
      if (sample.stamp > at) sample.stamp += jump;
    }
    for (Scan& scan : run->scans) {
      if (scan.stamp > at) scan.stamp += jump;
    }
  }

  void OneStamp(shiftmap::Run* run) {
    for (OdometrySample& sample : run->odometry) sample.stamp = run->odometry.front().stamp;
  }

  void CutShort(shiftmap::Run* run) {
    run->odometry.resize(1 + Below(run->odometry.size()));
    run->scans.resize(1 + Below(run->scans.size()));
  }

  void StandStill(shiftmap::Run* run) {
    for (OdometrySample& sample : run->odometry) sample = {sample.stamp, 0.0, 0.0};
  }

  void ScansAtAnotherTime(shiftmap::Run* run) {
    const Duration shift = FromSeconds(Uniform(-100.0, 100.0));
    for (Scan& scan : run->scans) scan.stamp += shift;
  }

  void AllInALine(shiftmap::Run* run) {
    for (Scan& scan : run->scans) {
      for (Observation& observation : scan.observations) observation.z.y() = 0.0;
    }
  }

  std::mt19937_64 random_;
};

TEST(OddRuns, GiveAValidMapOrSayWhatIsWrong) {
  const std::uint64_t first = testing::TestSeed(1);
  int maps = 0;
  int refused = 0;
  for (std::uint64_t seed = first; seed < first + 120; ++seed) {
    OpenWorldOptions options = testing::SmallWorld(seed % 10 + 1);
    options.groups = 8;
    options.duration_s = 30.0;
    options.runs = 3;
    std::vector<MapperInput> inputs = testing::Inputs(testing::Simulate(options));
    OddRuns odd(seed);
    std::optional<MapContent> prior;
    for (int night = 0; night < 2; ++night) {
      odd.Change(&inputs[odd.Below(inputs.size())].run);
      const StatusOr<MapperResult> result = BuildMap(inputs, prior, {});
      if (!result.ok()) {
        EXPECT_THAT(result.status(), testing::StatusIs(StatusCode::kInvalidArgument, "run"))
            << seed;
        ++refused;
        break;
      }
      EXPECT_THAT(ValidateMapContent(result->content), testing::IsOk()) << seed;
      for (const MappedRun& run : result->runs) {
        for (const VisitEvidence& visit : run.evidence) {
          EXPECT_TRUE(run.begin <= visit.begin && visit.end <= run.end) << seed << ' ' << run.name;
        }
      }
      prior = result->content;
      ++maps;
    }
  }
  EXPECT_GT(maps, 230);  // Of 240: there is a run that makes sense in each build.
  RecordProperty("maps", maps);
  RecordProperty("refused", refused);
}

// Laps of a circle to the left among landmarks about it: no turn to the right tells the sign of
// yaw rates from their scale.
MapperInput Laps(int day, double range_factor, double bearing_factor) {
  constexpr double kRadius = 8.0;  // [m]
  constexpr int kLandmarks = 12;
  std::mt19937_64 random(static_cast<std::uint64_t>(day));
  std::normal_distribution<double> noise;
  MapperInput input{fmt::format("day-{}", day), fmt::format("{:064x}", day), {}};
  input.run.info.vehicle = "robot";
  for (int i = 0; i < 1500; ++i) {
    const Stamp stamp = OpenWorldOptions().start + std::chrono::days(day) + FromSeconds(0.1 * i);
    input.run.odometry.push_back(
        {stamp, 1.0 + 0.003 * noise(random), 1.0 / kRadius + 0.003 * noise(random)});
    if (i % 2 == 0) continue;
    const double yaw = 0.1 * i / kRadius;
    const Se2 T_map_vehicle(kRadius * std::sin(yaw), -kRadius * std::cos(yaw), yaw);
    Scan scan{stamp, {}};
    for (int k = 0; k < kLandmarks; ++k) {
      const double angle = 2.0 * std::numbers::pi * k / kLandmarks;
      const double distance = 9.0 + std::fmod(2.3 * k, 5.0);
      const Eigen::Vector2d q =
          T_map_vehicle.Inverse() *
          Eigen::Vector2d(distance * std::cos(angle), distance * std::sin(angle));
      const double bearing = std::atan2(q.y(), q.x());
      if (q.norm() > 12.0 || std::abs(bearing) > 1.2) continue;
      Observation observation;
      observation.signature = Signature(fmt::format("L{}", k));
      observation.z = {range_factor * (q.norm() + 0.05 * noise(random)),
                       bearing_factor * (bearing + 0.01 * noise(random))};
      scan.observations.push_back(observation);
    }
    input.run.scans.push_back(std::move(scan));
  }
  return input;
}

TEST(OddRuns, OfTurnsTheWrongWayAreLeftOut) {
  const StatusOr<MapperResult> result =
      BuildMap({Laps(0, 1.0, 1.0), Laps(1, 1.0, -1.0)}, std::nullopt, {});
  ASSERT_THAT(result, testing::IsOk());
  ASSERT_EQ(result->runs.size(), 1u);
  EXPECT_EQ(result->runs[0].name, "day-0");
  ASSERT_EQ(result->rejected.size(), 1u);
  EXPECT_THAT(result->rejected[0].reason, ::testing::HasSubstr("wrong sign"));
  EXPECT_THAT(BuildMap({Laps(0, 1.0, -1.0), Laps(1, 1.0, -1.0)}, std::nullopt, {}),
              testing::StatusIs(StatusCode::kInvalidArgument,
                                "'day-0': it fits only if it turns the other way"));
}

TEST(OddRuns, OfBearingsInDegreesAreLeftOut) {
  constexpr double kDegrees = 180.0 / std::numbers::pi;
  EXPECT_THAT(
      BuildMap({Laps(0, 1.0, kDegrees)}, std::nullopt, {}),
      testing::StatusIs(StatusCode::kInvalidArgument, "'day-0': it fits only with bearings"));
}

TEST(OddRuns, OfNothingButOutliersAreLeftOut) {
  const StatusOr<MapperResult> result =
      BuildMap({Laps(0, 1.0, 1.0), Laps(1, 100.0, 1.0), Laps(2, 100.0, 1.0)}, std::nullopt, {});
  ASSERT_THAT(result, testing::IsOk());
  EXPECT_EQ(result->runs.size(), 1u);
  ASSERT_EQ(result->rejected.size(), 2u);
  for (const RejectedRun& run : result->rejected) EXPECT_EQ(run.reason, kOutliersReason);
  EXPECT_THAT(BuildMap({Laps(1, 100.0, 1.0)}, std::nullopt, {}),
              testing::StatusIs(StatusCode::kInvalidArgument,
                                "'day-1': all its observations are outliers"));
}

}  // namespace
}  // namespace shiftmap
