// SPDX-License-Identifier: Apache-2.0
#include "tests/unit/localizer/simulated_run.h"

#include <cmath>
#include <utility>

#include "localizer/filter/known_map_filter.h"
#include "mapstore/geometry/angle.h"

namespace shiftmap {
namespace {

constexpr double kOdometryPeriod = 0.05;
constexpr int kSamplesPerScan = 5;

}  // namespace

MapContent MakeTwoModeMap(int groups, double size_m, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> place(-0.5 * size_m, 0.5 * size_m);
  MapContent content;
  std::vector<Eigen::Matrix2d> marginals;
  for (int i = 0; i < groups; ++i) {
    LandmarkGroup group;
    group.signature = Signature(std::to_string(100 + i));
    for (int number = 1; number <= 2; ++number) {
      Mode mode;
      mode.number = ModeNumber(number);
      mode.cov_p_map_landmark = Eigen::Matrix2d::Identity() * 0.0025;
      do {
        mode.p_map_landmark = {place(random), place(random)};
      } while (number == 2 && (mode.p_map_landmark - group.modes[0].p_map_landmark).norm() < 1.5);
      group.modes.push_back(mode);
      marginals.push_back(mode.cov_p_map_landmark);
    }
    group.chain = ModeChain::Uniform(2, 1e-6);
    group.probabilities = Eigen::Vector3d(0.02, 0.9, 0.08);
    content.groups.push_back(group);
  }
  content.covariance = JointCovariance(marginals, {});
  content.calibration.sensor.max_range_m = 8.0;
  content.stamp = StampFromSeconds(1000.0);
  return content;
}

void SetCovariance(const JointCovariance& covariance, MapContent* content) {
  content->covariance = covariance;
  int index = 0;
  for (LandmarkGroup& group : content->groups) {
    for (Mode& mode : group.modes) {
      mode.cov_p_map_landmark = covariance.Block(index, index);
      ++index;
    }
  }
}

MapSnapshot Snapshot(MapContent content) {
  return MapSnapshot("area", VersionNumber(1), "hash", std::move(content));
}

std::vector<Eigen::Vector2d> PositionsOf(const MapContent& content,
                                         const std::vector<int>& states) {
  std::vector<Eigen::Vector2d> positions;
  for (std::size_t i = 0; i < content.groups.size(); ++i) {
    const auto mode = static_cast<std::size_t>(states[i]) - 1;
    positions.push_back(content.groups[i].modes[mode].p_map_landmark);
  }
  return positions;
}

SimulatedRun Simulate(const MapContent& content,
                      const std::vector<Eigen::Vector2d>& truth,
                      const SimulationOptions& options) {
  std::mt19937_64 random(options.seed);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform;
  const OdometryCalibration& odometry = content.calibration.odometry;
  const SensorCalibration& sensor = content.calibration.sensor;
  const double scale_v = odometry.scale_v * std::exp(odometry.sd_log_scale * normal(random));
  const double scale_omega =
      odometry.scale_omega * std::exp(odometry.sd_log_scale * normal(random));
  const Eigen::Vector2d sd(sensor.sd_range_m, sensor.sd_bearing_rad);
  const Eigen::Vector2d bias =
      KnownMapFilter::kBiasShare * sd.cwiseProduct(Eigen::Vector2d(normal(random), normal(random)));

  std::mt19937_64 random_scale(options.seed + 1000);
  const double range_scale = std::exp(
      std::normal_distribution<double>(0.0, KnownMapFilter::kSdLogRangeScale)(random_scale));

  SimulatedRun simulated;
  simulated.run.info.vehicle = "simulated";
  Se2 T_map_vehicle = options.T_map_start;
  const Stamp begin = StampFromSeconds(1000.0);
  const int samples = static_cast<int>(options.duration_s / kOdometryPeriod);
  for (int i = 0; i < samples; ++i) {
    const Stamp stamp = begin + FromSeconds(i * kOdometryPeriod);
    if (i % kSamplesPerScan == 0) {
      Scan scan;
      scan.stamp = stamp;
      for (std::size_t j = 0; j < truth.size(); ++j) {
        const Eigen::Vector2d q = T_map_vehicle.Inverse() * truth[j];
        const Eigen::Vector2d expected(q.norm(), std::atan2(q.y(), q.x()));
        // Bearings of what is under the bumper are beyond any linearization.
        constexpr double kMinRange = 2.0;
        const bool in_view = expected.x() > kMinRange && expected.x() < sensor.max_range_m &&
                             std::abs(expected.y()) < sensor.max_bearing_rad;
        if (!in_view || uniform(random) > sensor.detection_probability) continue;
        Observation observation;
        const bool misread = uniform(random) < options.clutter_share;
        const std::size_t read = misread ? (j + 1) % truth.size() : j;
        observation.signature = content.groups[read].signature;
        observation.z = expected.cwiseProduct(Eigen::Vector2d(range_scale, 1.0)) + bias +
                        sd.cwiseProduct(Eigen::Vector2d(normal(random), normal(random)));
        observation.z.x() = std::max(observation.z.x(), 0.05);
        scan.observations.push_back(observation);
      }
      simulated.run.scans.push_back(scan);
      simulated.T_map_vehicle.push_back(T_map_vehicle);
    }
    simulated.run.odometry.push_back({stamp, options.v_mps, options.omega_radps});
    const double root_dt = std::sqrt(kOdometryPeriod);
    const Eigen::Vector3d noise(odometry.noise_v * root_dt * normal(random),
                                odometry.noise_v * root_dt * normal(random),
                                odometry.noise_omega * root_dt * normal(random));
    T_map_vehicle = T_map_vehicle *
                    Se2::Exp(Eigen::Vector3d(scale_v * options.v_mps * kOdometryPeriod,
                                             0.0,
                                             scale_omega * options.omega_radps * kOdometryPeriod) +
                             noise);
  }
  return simulated;
}

}  // namespace shiftmap
