// SPDX-License-Identifier: Apache-2.0
#include "tests/support/random_map.h"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <utility>
#include <vector>

namespace shiftmap::testing {
namespace {

double Uniform(std::mt19937_64& random, double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(random);
}

Mode RandomMode(std::mt19937_64& random, int number) {
  Mode mode;
  mode.number = ModeNumber(number);
  mode.p_map_landmark = {Uniform(random, -500.0, 500.0), Uniform(random, -500.0, 500.0)};
  mode.cov_p_map_landmark = RandomCovariance(random, 0.01);
  mode.last_seen = StampFromNanoseconds(static_cast<std::int64_t>(random() >> 3));
  return mode;
}

}  // namespace

std::uint64_t TestSeed(std::uint64_t fallback) {
  const char* text = std::getenv("SHIFTMAP_TEST_SEED");
  const std::uint64_t seed = text != nullptr ? std::strtoull(text, nullptr, 10) : fallback;
  std::printf("SHIFTMAP_TEST_SEED=%llu\n", static_cast<unsigned long long>(seed));
  return seed;
}

Eigen::Matrix2d RandomCovariance(std::mt19937_64& random, double scale) {
  Eigen::Matrix2d root;
  for (Eigen::Index i = 0; i < 4; ++i) root(i / 2, i % 2) = Uniform(random, -1.0, 1.0);
  Eigen::Matrix2d covariance =
      scale * (root * root.transpose() + 0.1 * Eigen::Matrix2d::Identity());
  covariance(1, 0) = covariance(0, 1);
  return covariance;
}

std::vector<Eigen::Vector2d> RandomPositions(std::mt19937_64& random, int count, double sd_m) {
  std::normal_distribution<double> normal(0.0, sd_m);
  std::vector<Eigen::Vector2d> positions;
  for (int i = 0; i < count; ++i) {
    const double x = normal(random);
    positions.emplace_back(x, normal(random));
  }
  return positions;
}

Eigen::VectorXd RandomDistribution(std::mt19937_64& random, int states) {
  Eigen::VectorXd weights(states);
  for (double& weight : weights) weight = Uniform(random, 0.05, 1.0);
  return weights / weights.sum();
}

LandmarkGroup RandomGroup(std::mt19937_64& random, const std::string& signature, int modes) {
  LandmarkGroup group;
  group.signature = Signature(signature);
  for (int number = 1; number <= modes; ++number) {
    group.modes.push_back(RandomMode(random, number));
  }
  group.chain = ModeChain::Uniform(modes, Uniform(random, 1e-7, 1e-4));
  group.probabilities = RandomDistribution(random, modes + 1);
  return group;
}

ChainRhythm RandomRhythm(std::mt19937_64& random, int states, Duration period) {
  const int phases = period == kRhythmDay ? 24 : 168;
  std::vector<Eigen::MatrixXd> rates;
  for (int phase = 0; phase < phases; ++phase) {
    Eigen::MatrixXd of_phase(states, states);
    for (double& rate : of_phase.reshaped()) rate = Uniform(random, 0.0, 1e-4);
    of_phase.diagonal().setZero();
    of_phase.diagonal() = -of_phase.rowwise().sum();
    rates.push_back(std::move(of_phase));
  }
  return *ChainRhythm::Make(period, std::move(rates));
}

VehicleCalibration RandomVehicle(std::mt19937_64& random, const std::string& name) {
  VehicleCalibration vehicle;
  for (double* value : VehicleValues(&vehicle)) *value = Uniform(random, 0.01, 0.5);
  for (NoiseEstimate* noise : {&vehicle.noise_v,
                               &vehicle.noise_omega,
                               &vehicle.range_m,
                               &vehicle.bearing_rad,
                               &vehicle.position_m}) {
    noise->dof = Uniform(random, 2.0, 500.0);
  }
  vehicle.vehicle = name;
  vehicle.runs = static_cast<std::int64_t>(random() % 100) + 1;
  vehicle.stamp = StampFromNanoseconds(static_cast<std::int64_t>(random() >> 3));
  return vehicle;
}

MapContent RandomContent(std::mt19937_64& random, const RandomMapOptions& options) {
  MapContent content;
  std::vector<Eigen::Matrix2d> diagonal;
  for (int i = 0; i < options.groups; ++i) {
    // Fixed width keeps the order of signatures that of the loop.
    const std::string signature = std::to_string(1'000'000 + i);
    const int modes = std::uniform_int_distribution<int>(1, options.max_modes)(random);
    content.groups.push_back(RandomGroup(random, signature, modes));
    for (const Mode& mode : content.groups.back().modes) {
      diagonal.push_back(mode.cov_p_map_landmark);
    }
  }
  for (int i = 0; i < std::min(options.rhythms, options.groups); ++i) {
    ModeChain& chain = content.groups[static_cast<std::size_t>(i)].chain;
    const Duration period = i % 2 == 0 ? kRhythmDay : kRhythmWeek;
    chain = *chain.WithRhythm(RandomRhythm(random, chain.states(), period));
  }
  std::vector<JointCovariance::CrossBlock> cross;
  const int modes = static_cast<int>(diagonal.size());
  for (int row = 0; row < modes; ++row) {
    for (int column = row + 1; column < std::min(modes, row + 10); ++column) {
      if (Uniform(random, 0.0, 1.0) >= options.cross_block_share) continue;
      Eigen::Matrix2d value;
      for (Eigen::Index i = 0; i < 4; ++i) value(i / 2, i % 2) = Uniform(random, -1e-4, 1e-4);
      cross.push_back({row, column, value});
    }
  }
  content.covariance = JointCovariance(std::move(diagonal), std::move(cross));
  for (int i = 0; i < options.anonymous_landmarks; ++i) {
    content.anonymous_landmarks.push_back(RandomMode(random, 1));
  }
  for (int i = 0; i < options.vehicles; ++i) {
    content.vehicles.push_back(RandomVehicle(random, "truck-" + std::to_string(i)));
  }
  content.calibration.odometry.scale_v = Uniform(random, 0.9, 1.1);
  content.calibration.odometry.lag_s = Uniform(random, -0.2, 0.2);
  content.calibration.sensor.detection_probability = Uniform(random, 0.1, 0.9);
  content.stamp = StampFromNanoseconds(options.stamp_ns);
  return content;
}

VisitEvidence RandomEvidence(std::mt19937_64& random,
                             const LandmarkGroup& group,
                             Stamp begin,
                             Stamp end) {
  VisitEvidence evidence;
  evidence.signature = group.signature;
  evidence.begin = begin;
  evidence.end = end;
  evidence.modes.push_back({kAbsent, Uniform(random, -5.0, 5.0)});
  for (const Mode& mode : group.modes) {
    evidence.modes.push_back({mode.number, Uniform(random, -5.0, 5.0)});
  }
  evidence.observations = static_cast<std::int64_t>(random() % 100);
  return evidence;
}

}  // namespace shiftmap::testing
