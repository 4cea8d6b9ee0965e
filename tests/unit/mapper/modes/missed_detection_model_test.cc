// SPDX-License-Identifier: Apache-2.0
#include "mapper/modes/missed_detection_model.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <random>

#include "localizer/models/detection_model.h"
#include "tests/support/random_map.h"

namespace shiftmap {
namespace {

using testing::TestSeed;

SensorCalibration Sensor(double detection_probability, double occluded = 0.05) {
  SensorCalibration sensor;
  sensor.detection_probability = detection_probability;
  sensor.occluded_visit_probability = occluded;
  return sensor;
}

DirectionCounts From(std::size_t direction, int scans) {
  DirectionCounts counts = {};
  counts[direction] = scans;
  return counts;
}

DirectionCounts FromAllAround(int scans) {
  DirectionCounts counts;
  counts.fill(scans);
  return counts;
}

TEST(DirectionOf, CutsTheCircleIntoEightFromTheNegativeXAxis) {
  EXPECT_EQ(DirectionOf({-1.0, -0.1}), 0u);
  EXPECT_EQ(DirectionOf({-0.1, -1.0}), 1u);
  EXPECT_EQ(DirectionOf({1.0, -0.1}), 3u);
  EXPECT_EQ(DirectionOf({1.0, 0.1}), 4u);
  EXPECT_EQ(DirectionOf({-1.0, 0.1}), 7u);
}

TEST(LogMissedPasses, OfNoPassProvesNothing) {
  EXPECT_EQ(LogMissedPasses({}, {}, Sensor(0.5), {}), 0.0);
}

// A detection probability that all landmarks share, and landmarks that all sides see: what is left
// is the model of one pass that the localizer has.
TEST(LogMissedPasses, IsThatOfTheLocalizerWhereLandmarksAreAlike) {
  const MissedDetectionOptions alike{.one_sided_probability = 0.0, .detection_concentration = 1e5};
  const double p = (7.0 + 0.5) / 16.0;  // A node of the integral.
  for (const int scans : {1, 3, 20}) {
    const double expected = LogMissedRun(scans * std::log1p(-p), 0.05);
    EXPECT_NEAR(LogMissedPasses({From(2, scans)}, {}, Sensor(p), alike), expected, 1e-3);
    EXPECT_NEAR(LogMissedPasses({From(2, scans), From(6, scans)}, {}, Sensor(p), alike),
                2.0 * expected,
                2e-3);
  }
}

// Beta-binomial: E[(1 - P)^n] = B(a, b + n) / B(a, b).
TEST(LogMissedPasses, IntegratesOverTheDetectionProbability) {
  const MissedDetectionOptions options{.one_sided_probability = 0.0,
                                       .detection_concentration = 5.0};
  const double a = 2.0;
  const double b = 3.0;
  const auto log_beta = [](double x, double y) {
    return std::lgamma(x) + std::lgamma(y) - std::lgamma(x + y);
  };
  for (const int scans : {1, 2, 5, 10}) {
    EXPECT_NEAR(LogMissedPasses({From(0, scans)}, {}, Sensor(a / (a + b), 1e-9), options),
                log_beta(a, b + scans) - log_beta(a, b),
                0.05)
        << scans;
    Visibility known;
    known.seen = From(0, 6);
    known.missed = From(0, 4);
    EXPECT_NEAR(LogMissedPasses({From(0, scans)}, known, Sensor(a / (a + b), 1e-9), options),
                log_beta(a + 6, b + 4 + scans) - log_beta(a + 6, b + 4),
                0.05)
        << scans;
  }
}

TEST(LogMissedPasses, OfOneSideAreBoundedByTheShareOfOneSidedLandmarks) {
  const MissedDetectionOptions options;
  const std::vector<DirectionCounts> from_one_side(20, From(3, 50));
  const double one_side = LogMissedPasses(from_one_side, {}, Sensor(0.9), options);
  // Half of the half circles do not contain a direction.
  EXPECT_GT(one_side, std::log(0.5 * options.one_sided_probability) - 1e-3);
  const std::vector<DirectionCounts> around(20, FromAllAround(50));
  EXPECT_LT(LogMissedPasses(around, {}, Sensor(0.9), options), one_side - 5.0);

  // Seen from there, it is no sign that shows its back.
  Visibility known;
  known.seen = From(3, 20);
  EXPECT_LT(LogMissedPasses(from_one_side, known, Sensor(0.9), options), one_side - 5.0);
  // Seen from opposite sides it is not one-sided at all.
  known.seen = FromAllAround(1);
  EXPECT_LT(LogMissedPasses(from_one_side, known, Sensor(0.9), options), one_side - 5.0);
}

TEST(LogMissedPasses, OfALandmarkThatIsHardToSeeProveLess) {
  Visibility hard;
  hard.seen = From(0, 5);
  hard.missed = From(0, 500);
  Visibility easy;
  easy.seen = From(0, 500);
  easy.missed = From(0, 5);
  const std::vector<DirectionCounts> passes(2, From(0, 10));
  EXPECT_GT(LogMissedPasses(passes, hard, Sensor(0.5), {}), -1.5);
  EXPECT_LT(LogMissedPasses(passes, easy, Sensor(0.5), {}), -5.0);
}

TEST(LogMissedPasses, IsFiniteForAnyCounts) {
  Visibility known;
  known.seen = FromAllAround(1'000'000);
  known.missed = FromAllAround(100'000'000);
  const std::vector<DirectionCounts> passes(1000, FromAllAround(1'000'000));
  const double value = LogMissedPasses(passes, known, Sensor(0.05), {});
  EXPECT_TRUE(std::isfinite(value)) << value;
  EXPECT_LE(value, 0.0);
}

// Landmarks drawn from the model, half of them away: where the model says that a landmark that was
// not detected is away with some probability, that share is away.
TEST(LogMissedPasses, AreCalibrated) {
  const MissedDetectionOptions options;
  const SensorCalibration sensor = Sensor(0.4);
  std::mt19937_64 random(TestSeed(5));
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  std::gamma_distribution<double> hits(options.detection_concentration * 0.4, 1.0);
  std::gamma_distribution<double> misses(options.detection_concentration * 0.6, 1.0);
  struct Bin {
    int count = 0;
    int away = 0;
    double expected = 0.0;
  };
  std::map<int, Bin> bins;
  for (int trial = 0; trial < 200'000; ++trial) {
    const bool away = uniform(random) < 0.5;
    const double a = hits(random);
    const double p = a / (a + misses(random));
    const bool one_sided = uniform(random) < options.one_sided_probability;
    const auto face = static_cast<std::size_t>(uniform(random) * 8.0);
    std::vector<DirectionCounts> passes;
    bool detected = false;
    const int count = 1 + static_cast<int>(uniform(random) * 4.0);
    for (int i = 0; i < count; ++i) {
      const auto direction = static_cast<std::size_t>(uniform(random) * 8.0);
      const int scans = 1 + static_cast<int>(uniform(random) * 10.0);
      passes.push_back(From(direction, scans));
      const bool occluded = uniform(random) < sensor.occluded_visit_probability;
      const bool visible = !one_sided || (direction + 8 - face) % 8 < 4;
      if (away || occluded || !visible) continue;
      for (int s = 0; s < scans; ++s) detected |= uniform(random) < p;
    }
    if (detected) continue;
    const double probability = 1.0 / (1.0 + std::exp(LogMissedPasses(passes, {}, sensor, options)));
    Bin& bin = bins[static_cast<int>(probability * 10.0)];
    ++bin.count;
    bin.away += away ? 1 : 0;
    bin.expected += probability;
  }
  int used = 0;
  for (const auto& [index, bin] : bins) {
    if (bin.count < 1000) continue;
    ++used;
    const double mean = bin.expected / bin.count;
    // Four standard deviations, and the error of the integral.
    EXPECT_NEAR(static_cast<double>(bin.away) / bin.count,
                mean,
                4.0 * std::sqrt(mean * (1.0 - mean) / bin.count) + 0.005)
        << index;
  }
  EXPECT_GE(used, 4);
}

}  // namespace
}  // namespace shiftmap
