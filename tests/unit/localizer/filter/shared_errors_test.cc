// SPDX-License-Identifier: Apache-2.0
#include "localizer/filter/shared_errors.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <numbers>
#include <random>
#include <vector>

namespace shiftmap {
namespace {

constexpr int kModes = 4;

JointCovariance Correlated(double correlation) {
  Eigen::MatrixXd dense = Eigen::MatrixXd::Identity(2 * kModes, 2 * kModes);
  for (int i = 0; i < 2 * kModes; ++i) {
    for (int j = i % 2; j < 2 * kModes; j += 2) {
      if (i != j) dense(i, j) = correlation;
    }
  }
  return JointCovariance::FromDense(0.04 * dense);
}

Eigen::MatrixXd Random(int rows, int columns, std::mt19937_64* random) {
  std::normal_distribution<double> normal;
  Eigen::MatrixXd matrix(rows, columns);
  for (int i = 0; i < rows; ++i) {
    for (int j = 0; j < columns; ++j) matrix(i, j) = normal(*random);
  }
  return matrix;
}

SharedErrors::Observed DrawObserved(int mode_index, std::mt19937_64* random) {
  SharedErrors::Observed observed;
  observed.mode_index = mode_index;
  observed.nu = 0.3 * Random(2, 1, random);
  observed.H_pose = Random(2, 3, random);
  observed.H_range_scale = Random(2, 1, random);
  observed.H_bias = Random(2, 2, random);
  observed.H_mode = Random(2, 2, random);
  observed.cov_bias = Eigen::Vector2d(0.01, 0.02).asDiagonal();
  observed.cov_noise = Eigen::Vector2d(0.02, 0.03).asDiagonal();
  return observed;
}

SharedErrors::StateMatrix StartCovariance() {
  SharedErrors::StateMatrix P = SharedErrors::StateMatrix::Identity() * 0.05;
  P(0, 2) = P(2, 0) = P(1, 5) = P(5, 1) = 0.02;
  return P;
}

// One unknown place, of group 3, after the modes.
constexpr int kPlaceGroup = 3;
constexpr double kPlaceVariance = 1e4;

// log N of all innovations together, whose errors are joint and were never estimated.
double LogLikelihoodOfAll(const std::vector<SharedErrors::Observed>& all,
                          const JointCovariance& covariance) {
  const auto n = static_cast<Eigen::Index>(2 * all.size());
  const Eigen::Index errors = 6 + 2 + 2 * (kModes + 1);
  Eigen::MatrixXd prior = Eigen::MatrixXd::Zero(errors, errors);
  prior.topLeftCorner<6, 6>() = StartCovariance();
  prior.block<2, 2>(6, 6) = all.front().cov_bias;
  prior.block<2 * kModes, 2 * kModes>(8, 8) = covariance.Dense();
  prior.bottomRightCorner<2, 2>() = kPlaceVariance * Eigen::Matrix2d::Identity();
  Eigen::MatrixXd H = Eigen::MatrixXd::Zero(n, errors);
  Eigen::MatrixXd noise = Eigen::MatrixXd::Zero(n, n);
  Eigen::VectorXd nu(n);
  for (Eigen::Index i = 0; i < n; i += 2) {
    const SharedErrors::Observed& observed = all[static_cast<std::size_t>(i / 2)];
    H.block<2, 3>(i, 0) = observed.H_pose;
    H.block<2, 1>(i, 5) = observed.H_range_scale;
    H.block<2, 2>(i, 6) = observed.H_bias;
    const int mode = observed.mode_index < 0 ? kModes : observed.mode_index;
    H.block<2, 2>(i, 8 + 2 * mode) = observed.H_mode;
    noise.block<2, 2>(i, i) = observed.cov_noise;
    nu.segment<2>(i) = observed.nu;
  }
  const Eigen::MatrixXd S = H * prior * H.transpose() + noise;
  return -0.5 * (nu.dot(S.ldlt().solve(nu)) + std::log(S.determinant()) +
                 static_cast<double>(n) * std::log(2.0 * std::numbers::pi));
}

TEST(SharedErrors, OneByOneIsAsAllTogether) {
  for (const double correlation : {0.0, 0.6}) {
    std::mt19937_64 random(7);
    const JointCovariance covariance = Correlated(correlation);
    SharedErrors errors(StartCovariance());
    std::vector<SharedErrors::Observed> all;
    double sum = 0.0;
    for (const int mode : {2, 0, 0, 2, 3, 1, 2, 1}) {
      const SharedErrors::Observed observed = DrawObserved(mode, &random);
      sum += errors.LogLikelihood(observed, covariance);
      EXPECT_TRUE(errors.Update(observed, covariance));
      all.push_back(observed);
    }
    EXPECT_NEAR(sum, LogLikelihoodOfAll(all, covariance), 1e-9) << correlation;
  }
}

TEST(SharedErrors, AnUnknownPlaceIsAModeOfWhichNothingIsKnown) {
  for (const double correlation : {0.0, 0.6}) {
    const JointCovariance covariance = Correlated(correlation);
    std::mt19937_64 random(3);
    std::vector<SharedErrors::Observed> all;
    SharedErrors errors(StartCovariance());
    double log_likelihood = 0.0;
    for (const int mode : {0, -1, 2, -1, 1, -1}) {
      const int index = mode < 0 ? SharedErrors::PlaceIndex(kPlaceGroup) : mode;
      all.push_back(DrawObserved(index, &random));
      all.back().cov_bias = all.front().cov_bias;
      log_likelihood += errors.LogLikelihood(all.back(), covariance);
      ASSERT_TRUE(errors.Update(all.back(), covariance));
    }
    EXPECT_NEAR(log_likelihood, LogLikelihoodOfAll(all, covariance), 1e-6);
    EXPECT_TRUE(errors.Has(SharedErrors::PlaceIndex(kPlaceGroup)));
    errors.Forget(SharedErrors::PlaceIndex(kPlaceGroup));
    EXPECT_FALSE(errors.Has(SharedErrors::PlaceIndex(kPlaceGroup)));
    EXPECT_TRUE(errors.Has(2));
  }
}

TEST(SharedErrors, ACorrectionOfTheFilterIsNoInformation) {
  std::mt19937_64 random(8);
  const JointCovariance covariance = Correlated(0.3);
  SharedErrors errors(StartCovariance());
  EXPECT_TRUE(errors.Update(DrawObserved(0, &random), covariance));
  SharedErrors moved = errors;
  SharedErrors::StateVector correction;
  correction << 0.1, -0.2, 0.05, 0.01, 0.02, 0.03;
  moved.Move(SharedErrors::StateMatrix::Identity(), correction);
  SharedErrors::Observed observed = DrawObserved(1, &random);
  const double before = errors.LogLikelihood(observed, covariance);
  observed.nu -= observed.H_pose * correction.head<3>() + observed.H_range_scale * correction(5);
  EXPECT_NEAR(moved.LogLikelihood(observed, covariance), before, 1e-12);
}

TEST(SharedErrors, LetsGoOfTheModeUnusedForLongest) {
  const int modes = SharedErrors::kMaxModes + 3;
  const std::vector<Eigen::Matrix2d> marginals(static_cast<std::size_t>(modes),
                                               0.04 * Eigen::Matrix2d::Identity());
  const JointCovariance covariance(marginals, {});
  std::mt19937_64 random(9);
  SharedErrors errors(StartCovariance());
  for (int mode = 0; mode < modes; ++mode)
    EXPECT_TRUE(errors.Update(DrawObserved(mode, &random), covariance));
  const SharedErrors::Observed observed = DrawObserved(modes - 1, &random);
  const double known = errors.LogLikelihood(observed, covariance);
  EXPECT_TRUE(errors.Update(observed, covariance));
  EXPECT_TRUE(std::isfinite(known));
  EXPECT_TRUE(std::isfinite(errors.LogLikelihood(DrawObserved(0, &random), covariance)));
}

}  // namespace
}  // namespace shiftmap
