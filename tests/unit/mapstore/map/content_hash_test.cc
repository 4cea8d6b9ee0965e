// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <set>
#include <vector>

#include "mapstore/map/map_snapshot.h"
#include "tests/support/random_map.h"

namespace shiftmap::testing {
namespace {

MapContent SomeContent() {
  std::mt19937_64 random(31);
  RandomMapOptions options;
  options.groups = 6;
  options.cross_block_share = 0.5;
  options.vehicles = 2;
  return RandomContent(random, options);
}

std::vector<Eigen::Matrix2d> Diagonal(const JointCovariance& covariance) {
  std::vector<Eigen::Matrix2d> diagonal;
  for (int i = 0; i < covariance.size(); ++i) diagonal.push_back(covariance.Block(i, i));
  return diagonal;
}

TEST(ContentHashTest, IsStable) {
  EXPECT_EQ(ContentHash(SomeContent()), ContentHash(SomeContent()));
  EXPECT_EQ(ContentHash(SomeContent()).size(), 64u);
}

TEST(ContentHashTest, OrderOfCrossBlocksDoesNotMatter) {
  MapContent content = SomeContent();
  const std::string hash = ContentHash(content);
  std::vector<JointCovariance::CrossBlock> blocks = content.covariance.cross_blocks();
  ASSERT_GT(blocks.size(), 3u);
  std::reverse(blocks.begin(), blocks.end());
  content.covariance = JointCovariance(Diagonal(content.covariance), blocks);
  EXPECT_EQ(ContentHash(content), hash);
}

TEST(ContentHashTest, NegativeZeroIsZero) {
  MapContent content = SomeContent();
  content.groups[0].modes[0].p_map_landmark.x() = 0.0;
  const std::string hash = ContentHash(content);
  content.groups[0].modes[0].p_map_landmark.x() = -0.0;
  EXPECT_EQ(ContentHash(content), hash);
}

TEST(ContentHashTest, EveryFieldChangesIt) {
  using Change = std::function<void(MapContent&)>;
  const auto nudge = [](double& value) { value += 1e-6; };
  std::vector<Change> changes = {
      [](MapContent& c) { c.stamp += Duration(1); },
      [](MapContent& c) { c.groups.pop_back(); },
      [](MapContent& c) { c.groups[1].signature = Signature("1000001x"); },
      [](MapContent& c) {
        const double rate = c.groups[1].chain.leave_rate_per_s();
        c.groups[1].chain = ModeChain::Uniform(c.groups[1].chain.states() - 1, 2.0 * rate);
      },
      [&](MapContent& c) { nudge(c.groups[1].probabilities(0)); },
      [&](MapContent& c) { nudge(c.groups[1].probabilities(1)); },
      [](MapContent& c) { c.groups[1].modes[0].number = ModeNumber(77); },
      [&](MapContent& c) { nudge(c.groups[1].modes[0].p_map_landmark.x()); },
      [&](MapContent& c) { nudge(c.groups[1].modes[0].p_map_landmark.y()); },
      [&](MapContent& c) { nudge(c.groups[1].modes[0].cov_p_map_landmark(0, 0)); },
      [&](MapContent& c) { nudge(c.groups[1].modes[0].cov_p_map_landmark(0, 1)); },
      [&](MapContent& c) { nudge(c.groups[1].modes[0].cov_p_map_landmark(1, 1)); },
      [](MapContent& c) { c.groups[1].modes[0].last_seen += Duration(1); },
      [](MapContent& c) { c.anonymous_landmarks.pop_back(); },
      [&](MapContent& c) { nudge(c.anonymous_landmarks[0].p_map_landmark.y()); },
      [](MapContent& c) { std::swap(c.anonymous_landmarks[0], c.anonymous_landmarks[1]); }};
  for (const int entry : {0, 1, 2, 3}) {
    changes.push_back([entry](MapContent& c) {
      auto blocks = c.covariance.cross_blocks();
      blocks[0].value(entry / 2, entry % 2) += 1e-6;
      c.covariance = JointCovariance(Diagonal(c.covariance), blocks);
    });
  }
  changes.push_back([](MapContent& c) {
    auto blocks = c.covariance.cross_blocks();
    blocks.pop_back();
    c.covariance = JointCovariance(Diagonal(c.covariance), blocks);
  });
  for (double OdometryCalibration::*field : {&OdometryCalibration::scale_v,
                                             &OdometryCalibration::scale_omega,
                                             &OdometryCalibration::lag_s,
                                             &OdometryCalibration::sd_log_scale,
                                             &OdometryCalibration::noise_v,
                                             &OdometryCalibration::noise_omega}) {
    changes.push_back([=](MapContent& c) { nudge(c.calibration.odometry.*field); });
  }
  for (double SensorCalibration::*field : {&SensorCalibration::sd_range_m,
                                           &SensorCalibration::sd_bearing_rad,
                                           &SensorCalibration::sd_position_m,
                                           &SensorCalibration::range_curvature_per_rad2,
                                           &SensorCalibration::mean_squared_bearing_rad2,
                                           &SensorCalibration::max_range_m,
                                           &SensorCalibration::max_bearing_rad,
                                           &SensorCalibration::detection_probability,
                                           &SensorCalibration::occluded_visit_probability,
                                           &SensorCalibration::clutter_density_per_m2,
                                           &SensorCalibration::new_landmark_density_per_m2}) {
    changes.push_back([=](MapContent& c) { nudge(c.calibration.sensor.*field); });
  }
  changes.push_back([](MapContent& c) { c.vehicles.pop_back(); });
  changes.push_back([](MapContent& c) { c.vehicles[1].vehicle += "x"; });
  changes.push_back([](MapContent& c) { ++c.vehicles[1].runs; });
  changes.push_back([](MapContent& c) { c.vehicles[1].stamp += Duration(1); });
  for (std::size_t i = 0; i < kVehicleValues; ++i) {
    changes.push_back([=](MapContent& c) { nudge(*VehicleValues(&c.vehicles[1])[i]); });
  }
  std::set<std::string> hashes = {ContentHash(SomeContent())};
  for (std::size_t i = 0; i < changes.size(); ++i) {
    MapContent content = SomeContent();
    changes[i](content);
    EXPECT_TRUE(hashes.insert(ContentHash(content)).second) << "change " << i;
  }
}

}  // namespace
}  // namespace shiftmap::testing
