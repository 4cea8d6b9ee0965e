// SPDX-License-Identifier: Apache-2.0
//
// Covariances against samples: points drawn in the sensor's frame, looked at in the vehicle's.
#include "tools/convert/rosbag2/planar_observation.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <functional>
#include <random>

namespace shiftmap::rosbag2 {
namespace {

constexpr int kSamples = 40'000;

// Of a variance estimated from so many samples: four standard deviations.
const double kTolerance = 4.0 * std::sqrt(2.0 / kSamples);

Eigen::Matrix2d SampleCovariance(const std::function<Eigen::Vector2d()>& draw) {
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  Eigen::Matrix2d squares = Eigen::Matrix2d::Zero();
  for (int i = 0; i < kSamples; ++i) {
    const Eigen::Vector2d p = draw();
    sum += p;
    squares += p * p.transpose();
  }
  const Eigen::Vector2d mean = sum / kSamples;
  return squares / kSamples - mean * mean.transpose();
}

void ExpectNear(const Eigen::Matrix2d& actual, const Eigen::Matrix2d& sampled) {
  EXPECT_LT((actual - sampled).norm(), kTolerance * sampled.norm()) << actual << "\nexpected\n"
                                                                    << sampled;
}

// A camera to the left of the vehicle, tilted and turned.
Eigen::Isometry3d Mount() {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = (Eigen::AngleAxisd(0.7, Eigen::Vector3d::UnitZ()) *
                Eigen::AngleAxisd(-0.4, Eigen::Vector3d::UnitY()) *
                Eigen::AngleAxisd(0.2, Eigen::Vector3d::UnitX()))
                   .toRotationMatrix();
  T.translation() = Eigen::Vector3d(0.5, 0.3, 1.2);
  return T;
}

TEST(PlanarObservation, ProjectsTheCovarianceOfATiltedSensor) {
  std::mt19937_64 random(1);
  std::normal_distribution<double> normal;
  Detection detection;
  detection.p_frame_landmark = Eigen::Vector3d(4.0, -1.0, 0.5);
  Eigen::Matrix3d cov;
  cov << 0.09, 0.01, 0.02, 0.01, 0.04, -0.01, 0.02, -0.01, 0.25;
  detection.cov_p = cov;
  const Observation observation = ToPlanar(detection, Mount(), {});
  ASSERT_TRUE(observation.cov_z.has_value());
  EXPECT_EQ(observation.kind, Observation::Kind::kCartesian);
  EXPECT_EQ(observation.z, (Mount() * detection.p_frame_landmark).head<2>());
  const Eigen::Matrix3d L = cov.llt().matrixL();
  ExpectNear(*observation.cov_z, SampleCovariance([&]() -> Eigen::Vector2d {
    const Eigen::Vector3d noise(normal(random), normal(random), normal(random));
    return (Mount() * (detection.p_frame_landmark + L * noise)).head<2>();
  }));
}

TEST(PlanarObservation, RangeAndBearingAreTheSensors) {
  std::mt19937_64 random(2);
  std::normal_distribution<double> normal;
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() = Eigen::Vector3d(0.5, -2.0, 1.0);
  Detection detection;
  detection.p_frame_landmark = Eigen::Vector3d(3.0, 4.0, 0.0);
  Rosbag2Options options;
  options.covariance = CovarianceModel::kRangeBearing;
  options.sd_range_m = 0.2;
  options.sd_bearing_rad = 0.01;
  ExpectNear(*ToPlanar(detection, T, options).cov_z, SampleCovariance([&]() -> Eigen::Vector2d {
    const double range_m = 5.0 + 0.2 * normal(random);
    const double bearing_rad = std::atan2(4.0, 3.0) + 0.01 * normal(random);
    return {0.5 + range_m * std::cos(bearing_rad), -2.0 + range_m * std::sin(bearing_rad)};
  }));
}

TEST(PlanarObservation, WithoutACovarianceItIsRangeAndBearing) {
  Detection detection;
  detection.p_frame_landmark = Eigen::Vector3d(0.0, 2.0, 7.0);
  Eigen::Matrix3d vertical = Eigen::Matrix3d::Zero();
  vertical(2, 2) = 1.0;  // Says nothing of x and y.
  for (const auto& cov : {std::optional<Eigen::Matrix3d>(), std::optional(vertical)}) {
    detection.cov_p = cov;
    const Observation observation = ToPlanar(detection, Eigen::Isometry3d::Identity(), {});
    EXPECT_EQ(observation.kind, Observation::Kind::kRangeBearing);
    EXPECT_FALSE(observation.cov_z.has_value());
    EXPECT_DOUBLE_EQ(observation.z.x(), 2.0);
    EXPECT_DOUBLE_EQ(observation.z.y(), std::acos(0.0));
  }
}

}  // namespace
}  // namespace shiftmap::rosbag2
