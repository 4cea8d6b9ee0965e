// SPDX-License-Identifier: Apache-2.0
#include "mapper/modes/visit_density.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <vector>

#include "localizer/hypothesis/log_math.h"
#include "mapstore/geometry/covariance.h"
#include "mapstore/geometry/se2.h"

namespace shiftmap {
namespace {

constexpr double kRadiusM = 0.5;
constexpr double kMisread = 1e-5;  // β_B.

SensorCalibration Sensor() {
  SensorCalibration sensor;
  sensor.detection_probability = 0.8;
  sensor.clutter_density_per_m2 = 1e-3;
  sensor.new_landmark_density_per_m2 = 1e-4;
  return sensor;
}

// Sightings of a landmark with sensor noise of its own each, and a share that is anywhere.
class RandomVisit {
 public:
  explicit RandomVisit(std::uint64_t seed) : random_(seed) {}

  std::vector<SeenPlace> Sightings(const Eigen::Vector2d& place, int count, double misread) {
    std::vector<SeenPlace> seen;
    for (int i = 0; i < count; ++i) {
      const Eigen::Matrix2d R = Se2(0.0, 0.0, Uniform(-3.0, 3.0)).Rotation();
      const Eigen::Vector2d sd(Uniform(0.06, 0.1), Uniform(0.06, 0.2));
      Eigen::Vector2d position = place + R * Eigen::Vector2d(sd.x() * Normal(), sd.y() * Normal());
      if (Uniform(0.0, 1.0) < misread) position = {Uniform(-3.0, 3.0), Uniform(-3.0, 3.0)};
      seen.push_back({position, R * sd.cwiseAbs2().asDiagonal() * R.transpose()});
    }
    return seen;
  }

  double Uniform(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random_);
  }
  double Normal() { return std::normal_distribution<double>()(random_); }
  std::mt19937_64& random() { return random_; }

 private:
  std::mt19937_64 random_;
};

// A square of 4 m around the origin, as cells.
class Grid {
 public:
  static constexpr double kStepM = 0.05;
  static constexpr int kCells = 80;

  static Eigen::Vector2d Centre(int cell) {
    const int row = cell / kCells;
    const int column = cell % kCells;
    return {(row - 0.5 * kCells) * kStepM, (column - 0.5 * kCells) * kStepM};
  }
  static double Sum(const Eigen::VectorXd& cells) { return cells.sum() * kStepM * kStepM; }
};

// P_D t of every sighting (columns) in every cell.
Eigen::MatrixXd Detections(const std::vector<SeenPlace>& seen) {
  Eigen::MatrixXd result(Grid::kCells * Grid::kCells, static_cast<Eigen::Index>(seen.size()));
  for (std::size_t i = 0; i < seen.size(); ++i) {
    const VisitDensity one({seen[i]}, Sensor(), kMisread, kRadiusM);
    for (int cell = 0; cell < result.rows(); ++cell) {
      result(cell, static_cast<Eigen::Index>(i)) =
          std::exp(one.LogGiven({Grid::Centre(cell)})) - Sensor().clutter_density_per_m2;
    }
  }
  return result;
}

// Of the product over sightings what is not of false alarms and `other` alone, over all cells.
double BeyondOther(const Eigen::MatrixXd& detections, const Eigen::RowVectorXd& other) {
  const Eigen::VectorXd all = (detections.rowwise() + other).array().rowwise().prod().matrix();
  return Grid::Sum((all.array() - other.prod()).matrix());
}

// Modes that the sightings are at, near to, between, and far from; some are misread, each or in a
// burst.
TEST(VisitDensity, IsTheIntegralOverThePlacesOfTheLandmarkAndOfWhatIsMisread) {
  const double clutter = Sensor().clutter_density_per_m2;
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    RandomVisit visit(seed);
    const auto count = static_cast<int>(1 + seed % 5 * 2);
    std::vector<SeenPlace> seen = visit.Sightings({0.3, -0.2}, count, seed % 3 == 0 ? 0.3 : 0.0);
    if (seed % 2 == 0) {
      for (const SeenPlace& misread : visit.Sightings({-0.8, 0.6}, 3, 0.0)) seen.push_back(misread);
    }
    const Eigen::MatrixXd detections = Detections(seen);
    for (Eigen::Index i = 0; i < detections.cols() && seed % 3 != 0; ++i)
      EXPECT_NEAR(Grid::Sum(detections.col(i)), Sensor().detection_probability, 0.04);
    Eigen::VectorXd f(detections.rows());
    for (Eigen::Index q = 0; q < f.size(); ++q) {
      const Eigen::RowVectorXd landmark = detections.row(q).array() + clutter;
      f[q] = landmark.prod() + kMisread * BeyondOther(detections, landmark);
    }
    const VisitDensity density(seen, Sensor(), kMisread, kRadiusM);
    const Eigen::Matrix2d cov = Eigen::Vector2d(0.01, 0.02).asDiagonal();
    for (const double distance : {0.0, 0.2, 0.5, 1.2}) {
      const Eigen::Vector2d p = Eigen::Vector2d(0.3, -0.2) + distance * Eigen::Vector2d(-0.6, 0.8);
      Eigen::VectorXd at_mode = f;
      for (int q = 0; q < f.size(); ++q)
        at_mode[q] *= std::exp(LogGaussian(Grid::Centre(q) - p, cov));
      EXPECT_NEAR(density.LogUnderMode(p, cov), std::log(Grid::Sum(at_mode)), 0.5)
          << seed << ' ' << distance;
    }
    const Eigen::RowVectorXd no_landmark = Eigen::RowVectorXd::Constant(detections.cols(), clutter);
    const double without = no_landmark.prod() + kMisread * BeyondOther(detections, no_landmark);
    const double anywhere = Grid::Sum((f.array() - without).matrix());
    // Of two places either may be the landmark's, and one of the maxima counts: up to log 2 less.
    const double absent = std::log(without + Sensor().new_landmark_density_per_m2 * anywhere);
    EXPECT_NEAR(density.LogAbsent(), absent - 0.5 * std::log(2.0), 0.5 + 0.5 * std::log(2.0))
        << seed;
  }
}

TEST(VisitDensity, DoesNotDependOnTheFrameNorOnTheOrderOfSightings) {
  RandomVisit visit(3);
  std::vector<SeenPlace> seen = visit.Sightings({1.0, 2.0}, 20, 0.2);
  const Eigen::Vector2d p(1.1, 2.3);
  const Eigen::Matrix2d cov = Eigen::Vector2d(0.01, 0.04).asDiagonal();
  const VisitDensity before(seen, Sensor(), kMisread, kRadiusM);
  const Se2 T(30.0, -20.0, 2.0);
  const Eigen::Matrix2d R = T.Rotation();
  std::shuffle(seen.begin(), seen.end(), visit.random());
  for (SeenPlace& place : seen) {
    place.position = T * place.position;
    place.cov = (R * place.cov * R.transpose()).eval();
  }
  const VisitDensity after(seen, Sensor(), kMisread, kRadiusM);
  EXPECT_NEAR(
      after.LogUnderMode(T * p, R * cov * R.transpose()), before.LogUnderMode(p, cov), 1e-3);
  EXPECT_NEAR(after.LogAbsent(), before.LogAbsent(), 1e-3);
}

// They share the error of pose and map: what many of them are off by is no more against the mode
// than what one very good sighting is.
TEST(VisitDensity, ManySightingsAreOneInnovation) {
  const Eigen::Vector2d p(0.0, 0.0);
  const Eigen::Matrix2d cov = 0.01 * Eigen::Matrix2d::Identity();
  for (const double off : {0.0, 0.3, 0.6}) {
    for (const int count : {50, 500}) {
      std::vector<SeenPlace> seen(static_cast<std::size_t>(count));
      for (SeenPlace& place : seen) {
        place.position = {off, 0.0};
        place.cov = 0.01 * Eigen::Matrix2d::Identity();
      }
      const VisitDensity density(seen, Sensor(), kMisread, kRadiusM);
      const double expected =
          LogGaussian({off, 0.0}, cov) - std::log(Sensor().new_landmark_density_per_m2);
      EXPECT_NEAR(density.LogUnderMode(p, cov) - density.LogAbsent(), expected, 0.6)
          << off << ' ' << count;
    }
  }
}

// However many scans read something wrongly, they are one place: a landmark that is new there is
// likelier than a mistake by the rates of both.
TEST(VisitDensity, ABurstOfMisreadSightingsIsOneMistake) {
  const Eigen::Matrix2d cov = 0.01 * Eigen::Matrix2d::Identity();
  const double rates = Sensor().new_landmark_density_per_m2 / kMisread;
  RandomVisit visit(8);
  for (const int count : {20, 200}) {
    const std::vector<SeenPlace> burst = visit.Sightings({1.8, 0.0}, count, 0.0);
    const VisitDensity alone(burst, Sensor(), kMisread, kRadiusM);
    EXPECT_NEAR(alone.LogAbsent() - alone.LogUnderMode({0.0, 0.0}, cov), std::log1p(rates), 0.1);
    // A visit that sees the landmark at its mode too.
    std::vector<SeenPlace> both = visit.Sightings({0.0, 0.0}, 10, 0.0);
    both.insert(both.end(), burst.begin(), burst.end());
    const VisitDensity density(both, Sensor(), kMisread, kRadiusM);
    EXPECT_GT(density.LogUnderMode({0.0, 0.0}, cov), density.LogAbsent() + 5.0);
    EXPECT_GT(density.LogUnderMode({0.0, 0.0}, cov), density.LogUnderMode({1.8, 0.0}, cov) - 0.5);
  }
}

TEST(VisitDensity, OneMisreadSightingTellsOfNoMode) {
  RandomVisit visit(5);
  std::vector<SeenPlace> seen = visit.Sightings({0.0, 0.0}, 1, 0.0);
  const Eigen::Matrix2d cov = 0.01 * Eigen::Matrix2d::Identity();
  const VisitDensity one(seen, Sensor(), kMisread, kRadiusM);
  // A false alarm or a new landmark, against a false alarm.
  const double rate = Sensor().new_landmark_density_per_m2 / Sensor().clutter_density_per_m2;
  EXPECT_NEAR(one.LogAbsent() - one.LogUnderMode({2.0, 0.0}, cov), std::log1p(0.8 * rate), 0.05);
}

// Values that logs may have: no number is lost. What is known in no direction tells nothing.
TEST(VisitDensity, IsFiniteWhateverTheNoise) {
  for (const double x : {1e-17, 1.0, 1e17}) {
    for (const double y : {1e-17, 1.0, 1e17}) {
      for (const double turn : {0.0, 0.25 * std::numbers::pi, 1.0}) {
        const Eigen::Matrix2d R = Se2(0.0, 0.0, turn).Rotation();
        const Eigen::Matrix2d cov = R * Eigen::Vector2d(x, y).asDiagonal() * R.transpose();
        const VisitDensity density(
            {{{1e8, -1e8}, cov}, {{1.0, 2.0}, cov}}, Sensor(), kMisread, kRadiusM);
        const double at_mode = density.LogUnderMode({0.0, 0.0}, 0.01 * Eigen::Matrix2d::Identity());
        EXPECT_TRUE(std::isfinite(density.LogAbsent())) << x << ' ' << y << ' ' << turn;
        EXPECT_TRUE(std::isfinite(at_mode)) << x << ' ' << y << ' ' << turn;
        if (std::max(x, y) > 1e6) {
          EXPECT_NEAR(density.LogAbsent(), at_mode, 1e-9);
        }
      }
    }
  }
}

}  // namespace
}  // namespace shiftmap
