// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/mine_drive.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <set>

#include "mapstore/geometry/angle.h"
#include "tests/support/geometry_matchers.h"
#include "tests/support/ray_caster.h"
#include "tests/support/status_matchers.h"

namespace shiftmap {
namespace {

using testing::IsNearPose;
using testing::IsOk;
using testing::StatusIs;

constexpr std::uint64_t kSeed = 9;

const MineSite& Site() {
  static const MineSite site = *MakeMineSite(
      *GenerateMinePlan({.seed = 2, .length_m = 70.0, .drawpoints = 4, .crosscuts = 0}),
      {.seed = 2, .tags = 8, .corners = true});
  return site;
}

std::vector<ModeNumber> FirstPlacesOf(const MineSite& site) {
  return std::vector<ModeNumber>(site.groups.size(), ModeNumber(1));
}

std::vector<ModeNumber> FirstPlaces() { return FirstPlacesOf(Site()); }

SimulatedDrive Drive(const MineDriveOptions& options,
                     PlanVersion version = PlanVersion::kOriginal,
                     std::uint64_t seed = kSeed) {
  StatusOr<SimulatedDrive> drive = SimulateDrive(Site(), version, FirstPlaces(), options, seed);
  EXPECT_THAT(drive, IsOk());
  return *std::move(drive);
}

MineDriveOptions WithLidars() {
  MineDriveOptions options;
  options.driver.legs = 1;
  options.lidars = FrontAndRearLidar();
  options.points = true;
  return options;
}

TEST(MineDrive, WithoutNoiseOdometryIntegratesToTheTruth) {
  MineDriveOptions options;
  options.odometry = {.noise_v = 0.0, .noise_omega = 0.0};
  const SimulatedDrive drive = Drive(options);
  const std::vector<StampedPose>& truth = drive.simulated.truth;
  ASSERT_EQ(truth.size(), drive.simulated.run.odometry.size());
  ASSERT_EQ(truth.size(), drive.articulation_rad.size());
  Se2 pose = truth.front().T_map_vehicle;
  for (std::size_t i = 0; i + 1 < truth.size(); ++i) {
    const OdometrySample& sample = drive.simulated.run.odometry[i];
    const double dt = ToSeconds(truth[i + 1].stamp - sample.stamp);
    pose = pose * Se2::Exp({sample.v_mps * dt, 0.0, sample.omega_radps * dt});
  }
  EXPECT_THAT(pose, IsNearPose(truth.back().T_map_vehicle, 1e-6));
  EXPECT_THAT(ValidateRun(drive.simulated.run), IsOk());
}

TEST(MineDrive, OdometryHasTheNoiseOfThePaper) {
  MineDriveOptions options;
  options.driver.legs = 10;
  options.odometry_noise = kTIvOdometryNoise;
  const SimulatedDrive drive = Drive(options);
  const std::size_t count = drive.true_odometry.size();
  ASSERT_GT(count, 5000U);
  const Eigen::Vector2d end = drive.simulated.truth.back().T_map_vehicle.translation();
  EXPECT_LT((end - Site().plan.path.front()).norm(), 1.0) << "back again, after ten legs";
  Eigen::Array2d sum(0.0, 0.0);
  Eigen::Array2d sum2(0.0, 0.0);
  Eigen::Array2d lagged(0.0, 0.0);
  Eigen::Array2d before(0.0, 0.0);
  for (std::size_t i = 0; i < count; ++i) {
    const OdometrySample& noisy = drive.simulated.run.odometry[i];
    const OdometrySample& exact = drive.true_odometry[i];
    const Eigen::Array2d error(noisy.v_mps - exact.v_mps, noisy.omega_radps - exact.omega_radps);
    sum += error;
    sum2 += error.square();
    lagged += error * before;
    before = error;
  }
  const auto n = static_cast<double>(count);
  const Eigen::Array2d sd(0.1, 5.0 / 57.29577951308232);
  // Four standard deviations of each estimate.
  for (int i = 0; i < 2; ++i) {
    EXPECT_NEAR(sum[i] / n, 0.0, 4.0 * sd[i] / std::sqrt(n));
    EXPECT_NEAR(std::sqrt(sum2[i] / n), sd[i], 4.0 * sd[i] / std::sqrt(2.0 * n));
    EXPECT_NEAR(lagged[i] / sum2[i], 0.0, 4.0 / std::sqrt(n)) << "it is white";
  }
}

TEST(MineDrive, TheSameSeedGivesTheSameBitsAndSensorsDoNotDisturbEachOther) {
  const SimulatedDrive a = Drive(WithLidars());
  const SimulatedDrive b = Drive(WithLidars());
  const SimulatedDrive other = Drive(WithLidars(), PlanVersion::kOriginal, kSeed + 1);
  MineDriveOptions blind = WithLidars();
  blind.lidars.clear();
  const SimulatedDrive without = Drive(blind);
  ASSERT_EQ(a.ranges.size(), b.ranges.size());
  for (std::size_t i = 0; i < a.ranges.size(); ++i) {
    EXPECT_EQ(a.ranges[i].ranges_m, b.ranges[i].ranges_m);
  }
  EXPECT_NE(a.ranges.back().ranges_m, other.ranges.back().ranges_m);
  ASSERT_EQ(a.simulated.truth.size(), without.simulated.truth.size());
  EXPECT_EQ(a.simulated.truth.back().T_map_vehicle.translation(),
            without.simulated.truth.back().T_map_vehicle.translation());
  for (std::size_t s = 0; s < a.simulated.run.scans.size(); ++s) {
    const std::vector<Observation>& all = a.simulated.run.scans[s].observations;
    const std::vector<Observation>& tags = without.simulated.run.scans[s].observations;
    ASSERT_GE(all.size(), tags.size());
    for (std::size_t i = 0; i < tags.size(); ++i) {
      EXPECT_EQ(all[i].signature, tags[i].signature);
      EXPECT_EQ(all[i].z, tags[i].z);
    }
  }
}

// The site with one more tag inside of each drawpoint, named after the barrier and place that hide
// it.
MineSite WithTagsBehindBarriers() {
  MineSite site = Site();
  for (std::size_t b = 0; b < site.barriers.size(); ++b) {
    for (std::size_t i = 0; i < site.barriers[b].size(); ++i) {
      const Wall& wall = site.barriers[b][i];
      const Eigen::Vector2d along = (wall.b - wall.a).normalized();
      const Eigen::Vector2d middle = 0.5 * (wall.a + wall.b);
      site.groups.push_back({Signature(fmt::format("X{}.{}", b, i)),
                             {middle - 2.0 * Eigen::Vector2d(-along.y(), along.x())}});
    }
  }
  return site;
}

int TimesSeen(const SimulatedDrive& drive, const std::string& signature) {
  int count = 0;
  for (const Scan& scan : drive.simulated.run.scans) {
    for (const Observation& z : scan.observations) count += z.signature.text() == signature;
  }
  return count;
}

TEST(MineDrive, AClosedBarrierHidesWhatIsBehindIt) {
  const MineSite site = WithTagsBehindBarriers();
  for (std::size_t b = 0; b < site.barriers.size(); ++b) {
    for (std::size_t i = 0; i < site.barriers[b].size(); ++i) {
      std::vector<ModeNumber> modes = FirstPlacesOf(site);
      const std::string tag = fmt::format("X{}.{}", b, i);
      modes[b] = ModeNumber(static_cast<std::int64_t>(i) + 1);
      const auto closed = SimulateDrive(site, PlanVersion::kOriginal, modes, {}, kSeed);
      ASSERT_THAT(closed, IsOk());
      EXPECT_EQ(TimesSeen(*closed, tag), 0) << tag;
      modes[b] = kAbsent;
      const auto open = SimulateDrive(site, PlanVersion::kOriginal, modes, {}, kSeed);
      ASSERT_THAT(open, IsOk());
      EXPECT_GT(TimesSeen(*open, tag), 10) << tag;
    }
  }
}

// By brute force over the walls that stand.
bool Hidden(const std::vector<Wall>& walls, const Eigen::Vector2d& p, const Eigen::Vector2d& q) {
  LidarSensor sensor;
  const Eigen::Vector2d way = q - p;
  const Se2 T_map_lidar(p, std::atan2(way.y(), way.x()));
  return CastScan(walls, T_map_lidar, 3, sensor)[1] < way.norm() - 1e-3;
}

TEST(MineDrive, NoTagIsSeenThroughAWallAndOthersWithTheStatedProbability) {
  MineDriveOptions options;
  options.tag_sensor.max_range_m = 40.0;
  options.driver.legs = 4;
  const MineSite site = WithTagsBehindBarriers();
  const StatusOr<SimulatedDrive> drive =
      SimulateDrive(site, PlanVersion::kOriginal, FirstPlacesOf(site), options, kSeed);
  ASSERT_THAT(drive, IsOk());
  const std::vector<Wall> walls = site.WallsOf(PlanVersion::kOriginal, FirstPlacesOf(site));
  int hidden = 0;
  int in_view = 0;
  int seen = 0;
  double sum_range2 = 0.0;
  double sum_bearing2 = 0.0;
  const auto& scans = drive->simulated.run.scans;
  for (std::size_t s = 0; s < scans.size(); ++s) {
    const Se2& pose = drive->simulated.truth[4 * s].T_map_vehicle;
    std::map<Signature, Eigen::Vector2d> expected;
    for (std::size_t g = 0; g < site.groups.size(); ++g) {
      if (g >= site.barriers.size() && g < site.barriers.size() + site.corners) continue;
      const Eigen::Vector2d q = pose.Inverse() * site.groups[g].modes[0];
      const double bearing = std::atan2(q.y(), q.x());
      if (q.norm() >= 40.0 || std::abs(bearing) >= options.tag_sensor.max_bearing_rad) continue;
      if (Hidden(walls, pose.translation(), site.groups[g].modes[0])) {
        ++hidden;
        continue;
      }
      expected[site.groups[g].signature] = {q.norm(), bearing};
    }
    in_view += static_cast<int>(expected.size());
    for (const Observation& observation : scans[s].observations) {
      const auto found = expected.find(observation.signature);
      ASSERT_NE(found, expected.end()) << observation.signature.text() << " behind a wall";
      ++seen;
      sum_range2 += std::pow(observation.z.x() - found->second.x(), 2);
      sum_bearing2 += std::pow(WrapAngle(observation.z.y() - found->second.y()), 2);
    }
  }
  EXPECT_GT(hidden, 100);
  ASSERT_GT(seen, 1000);
  EXPECT_NEAR(static_cast<double>(seen) / in_view, 0.8, 0.04);
  EXPECT_NEAR(std::sqrt(sum_range2 / seen), 0.1, 0.01);
  EXPECT_NEAR(std::sqrt(sum_bearing2 / seen), 0.02, 0.002);
}

TEST(MineDrive, SignedCornersAreWhereTheVersionHasThem) {
  for (const PlanVersion version : {PlanVersion::kOriginal, PlanVersion::kModified}) {
    MineDriveOptions options = WithLidars();
    for (SimulatedLidar& lidar : options.lidars) lidar.beams = 541;
    const SimulatedDrive drive = Drive(options, version);
    std::map<std::string, int> seen;
    int anonymous = 0;
    for (std::size_t s = 0; s < drive.simulated.run.scans.size(); ++s) {
      const Se2& pose = drive.simulated.truth[4 * s].T_map_vehicle;
      std::set<Signature> once;
      for (const Observation& observation : drive.simulated.run.scans[s].observations) {
        anonymous += observation.signature.anonymous();
        if (observation.signature.text().substr(0, 1) != "C") continue;
        EXPECT_TRUE(once.insert(observation.signature).second);
        ++seen[observation.signature.text()];
        const auto c = static_cast<std::size_t>(observation.signature.text().back() - '1');
        const MovedCorner& corner = Site().plan.corners[c];
        const Eigen::Vector2d& expected =
            version == PlanVersion::kOriginal ? corner.original : corner.modified;
        EXPECT_LT((pose * observation.PositionInVehicle() - expected).norm(), 0.75);
      }
    }
    EXPECT_EQ(seen.size(), 3U);
    EXPECT_GT(anonymous, 500);
    for (const auto& [signature, count] : seen) EXPECT_GT(count, 1) << signature;
  }
}

TEST(MineDrive, ScansAreTakenAtTheTruePose) {
  MineDriveOptions options = WithLidars();
  for (SimulatedLidar& lidar : options.lidars) {
    lidar.noise = {.base_sd_m = 0.0, .sd_per_m = 0.0, .grazing_cos = 0.0};
    lidar.beams = 31;
  }
  const SimulatedDrive drive = Drive(options);
  const std::vector<Wall> walls = Site().WallsOf(PlanVersion::kOriginal, FirstPlaces());
  ASSERT_EQ(drive.ranges.size(), 2 * drive.simulated.run.scans.size());
  for (std::size_t i = 0; i < drive.ranges.size(); i += 25) {
    const LidarRanges& scan = drive.ranges[i];
    ASSERT_EQ(scan.lidar, i % 2);
    ASSERT_EQ(scan.stamp, drive.simulated.truth[4 * (i / 2)].stamp);
    const LidarSensor& sensor = options.lidars[scan.lidar].sensor;
    const std::vector<double> expected =
        CastScan(walls,
                 drive.simulated.truth[4 * (i / 2)].T_map_vehicle * sensor.T_vehicle_lidar,
                 31,
                 sensor);
    for (std::size_t beam = 0; beam < 31; ++beam) {
      EXPECT_NEAR(scan.ranges_m[beam], expected[beam], 1e-6);
    }
  }
}

TEST(MineDrive, RefusesWhatCannotBeDriven) {
  MineDriveOptions options;
  const auto drive = [&](const std::vector<ModeNumber>& modes) {
    return SimulateDrive(Site(), PlanVersion::kOriginal, modes, options, kSeed);
  };
  EXPECT_THAT(drive({}), StatusIs(StatusCode::kInvalidArgument, "a place or 0"));
  options.path = {{0.0, 10.0}, {50.0, 10.0}};
  EXPECT_THAT(drive(FirstPlaces()), StatusIs(StatusCode::kInvalidArgument, "crosses a wall"));
  options.path = {{0.0, 10.0}};
  EXPECT_THAT(drive(FirstPlaces()), StatusIs(StatusCode::kInvalidArgument, "path of 1 points"));
  options = {};
  options.driver.speed_mps = 0.0;
  EXPECT_THAT(drive(FirstPlaces()), StatusIs(StatusCode::kInvalidArgument, "speed = 0"));
}

TEST(MineDrive, EndsWhenItsTimeIsUp) {
  MineDriveOptions options;
  options.max_duration_s = 5.0;
  EXPECT_EQ(Drive(options).simulated.truth.size(), 101U);
}

}  // namespace
}  // namespace shiftmap
