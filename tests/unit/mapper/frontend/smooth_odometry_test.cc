// SPDX-License-Identifier: Apache-2.0
#include "mapper/frontend/smooth_odometry.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <vector>

#include "tools/sim/random.h"

namespace shiftmap {
namespace {

constexpr double kPeriod = 0.05;

std::vector<OdometrySample> LogOf(const std::vector<double>& v) {
  std::vector<OdometrySample> odometry;
  for (const double v_k : v) {
    const double seconds = kPeriod * static_cast<double>(odometry.size());
    odometry.push_back({StampFromSeconds(100.0 + seconds), v_k, 0.0});
  }
  return odometry;
}

// The smoothed velocity of a random walk has the variance σ² (1 - ρ) / (1 + ρ), where the steps'
// variance is σ² (1 - ρ)² / ρ, and its error tells nothing of how it changes.
TEST(SmoothOdometry, IsTheMeanGivenAllSamples) {
  constexpr std::size_t kSamples = 50'000;
  constexpr double kSd = 0.1;
  for (const double decay : {0.5, 0.75, 0.9375}) {
    Random random = MakeRandom(5, static_cast<int>(100.0 * decay));
    std::vector<double> truth;
    std::vector<double> samples;
    double v = 1.0;
    for (std::size_t k = 0; k < kSamples; ++k) {
      truth.push_back(v);
      samples.push_back(v + Gaussian(kSd, &random));
      v += Gaussian(kSd * (1.0 - decay) / std::sqrt(decay), &random);
    }
    const std::vector<OdometrySample> smooth = SmoothOdometry(LogOf(samples));
    double variance = 0.0;
    double change = 0.0;
    double of_error = 0.0;
    for (std::size_t k = 1; k < kSamples; ++k) {
      const double error = truth[k] - smooth[k].v_mps;
      const double step = smooth[k].v_mps - smooth[k - 1].v_mps;
      const double true_step = truth[k] - truth[k - 1];
      variance += error * error / kSamples;
      change += step * step;
      of_error += (true_step - step) * step;
    }
    const double expected = kSd * kSd * (1.0 - decay) / (1.0 + decay);
    EXPECT_NEAR(variance / expected, 1.0, 0.05) << decay;
    EXPECT_NEAR(of_error / change, 0.0, 0.1) << decay;
    EXPECT_EQ(smooth[7].omega_radps, 0.0);
  }
}

TEST(SmoothOdometry, NothingChangesWhereAllChangeIsNoise) {
  constexpr double kSd = 0.1;
  Random random = MakeRandom(3, 1);
  std::vector<double> samples;
  for (int k = 0; k < 2'000; ++k) samples.push_back(1.0 + Gaussian(kSd, &random));
  for (const OdometrySample& sample : SmoothOdometry(LogOf(samples))) {
    EXPECT_NEAR(sample.v_mps, 1.0, 0.2 * kSd);
  }
}

TEST(SmoothOdometry, ALogWithoutNoiseIsLeftAsItIs) {
  std::vector<double> samples;
  for (int k = 0; k < 200; ++k) samples.push_back(k < 100 ? 0.01 * k : 1.5);
  const std::vector<OdometrySample> odometry = LogOf(samples);
  const std::vector<OdometrySample> smooth = SmoothOdometry(odometry);
  ASSERT_EQ(smooth.size(), odometry.size());
  for (std::size_t k = 0; k < smooth.size(); ++k) {
    EXPECT_EQ(smooth[k].stamp, odometry[k].stamp);
    EXPECT_EQ(smooth[k].v_mps, odometry[k].v_mps);
  }
}

TEST(SmoothOdometry, AShortLogHasAPeriod) {
  EXPECT_EQ(SmoothOdometry(LogOf({0.7})).front().v_mps, 0.7);
  EXPECT_GT(SamplePeriod(LogOf({0.7})), 0.0);
  EXPECT_NEAR(SamplePeriod(LogOf({0.7, 0.8, 0.9})), kPeriod, 1e-9);
}

}  // namespace
}  // namespace shiftmap
