// SPDX-License-Identifier: Apache-2.0
#include "localizer/filter/known_map_filter.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <limits>
#include <random>

#include "localizer/filter/odometry_buffer.h"
#include "tests/unit/localizer/simulated_run.h"

namespace shiftmap {
namespace {

// Correlated map: a common shift of all modes, and an error of each.
JointCovariance CorrelatedCovariance(int modes, double sd_common, double sd_own) {
  const Eigen::Index n = 2 * modes;
  Eigen::MatrixXd dense = Eigen::MatrixXd::Identity(n, n) * (sd_own * sd_own);
  for (Eigen::Index i = 0; i < n; ++i) {
    for (Eigen::Index j = i % 2; j < n; j += 2) dense(i, j) += sd_common * sd_common;
  }
  return JointCovariance::FromDense(dense);
}

MapContent CorrelatedMap(double sd_common, double sd_own, int groups = 8) {
  MapContent content = MakeTwoModeMap(groups, 12.0, 5);
  SetCovariance(CorrelatedCovariance(content.covariance.size(), sd_common, sd_own), &content);
  return content;
}

PoseWithCovariance Start(const Se2& T_map_vehicle) {
  return {T_map_vehicle, Eigen::Vector3d(0.01, 0.01, 0.0025).asDiagonal()};
}

// The same estimator, written as one dense Kalman filter over pose, scales, sensor bias, the whole
// map and landmarks at unknown places. A Schmidt-Kalman filter has a gain for the first six only.
class DenseFilter {
 public:
  DenseFilter(const PoseWithCovariance& start,
              const MapSnapshot& snapshot,
              int places = 0,
              bool schmidt = true)
      : snapshot_(snapshot), schmidt_(schmidt), T_(start.T_map_vehicle) {
    const Calibration& calibration = snapshot.calibration();
    const Eigen::Index modes = snapshot.covariance().size();
    const Eigen::Index n = 8 + 2 * modes + 2 * places;
    error_ = Eigen::VectorXd::Zero(n);
    P_ = Eigen::MatrixXd::Zero(n, n);
    P_.topLeftCorner<3, 3>() = start.cov_T_map_vehicle;
    const double sd_scale = calibration.odometry.sd_log_scale;
    P_(3, 3) = P_(4, 4) = sd_scale * sd_scale;
    P_(5, 5) = std::pow(KnownMapFilter::kSdLogRangeScale, 2);
    P_(6, 6) = std::pow(KnownMapFilter::kBiasShare * calibration.sensor.sd_range_m, 2);
    P_(7, 7) = std::pow(KnownMapFilter::kBiasShare * calibration.sensor.sd_bearing_rad, 2);
    bias_prior_ = P_.diagonal().segment<2>(6);
    P_.block(8, 8, 2 * modes, 2 * modes) = snapshot.covariance().Dense();
    for (Eigen::Index i = 8 + 2 * modes; i < n; ++i) P_(i, i) = 1e4;
  }

  void Predict(const MotionIncrement& increment, double elapsed_s) {
    const Eigen::Matrix<double, 3, 2> J = increment.J_calibration.leftCols<2>();
    const Se2 step = increment.T_begin_end * Se2::Exp(J * scale_.head<2>());
    T_ = T_ * step;
    Eigen::MatrixXd F = Eigen::MatrixXd::Identity(P_.rows(), P_.cols());
    F.topLeftCorner<3, 3>() = step.Inverse().Adjoint();
    F.block<3, 2>(0, 3) = J;
    F(5, 5) = std::exp(-elapsed_s / 300.0);
    scale_.z() *= F(5, 5);
    P_ = F * P_ * F.transpose();
    P_.topLeftCorner<3, 3>() += increment.cov;
    for (int i = 3; i < 5; ++i) P_(i, i) += 2.5e-7 * elapsed_s;
    P_(5, 5) += std::pow(KnownMapFilter::kSdLogRangeScale, 2) * (1.0 - F(5, 5) * F(5, 5));
    if (schmidt_) return;
    // Where it is estimated, the bias drifts.
    const double keep = std::exp(-elapsed_s / 60.0);
    error_.segment<2>(6) *= keep;
    for (int i = 6; i < 8; ++i) {
      P_.row(i) *= keep;
      P_.col(i) *= keep;
      P_(i, i) += (1.0 - keep * keep) * bias_prior_(i - 6);
    }
  }

  void Update(const Observation& observation, ModeRef mode) {
    const LandmarkGroup& group = snapshot_.groups()[static_cast<std::size_t>(mode.group)];
    Update(observation,
           snapshot_.ModeIndex(mode.group, mode.state),
           group.modes[static_cast<std::size_t>(mode.state) - 1].p_map_landmark);
  }

  // `place` from 0 on; its error is that of a point near by.
  void UpdatePlace(const Observation& observation, int place, const Eigen::Vector2d& point) {
    Update(observation, snapshot_.covariance().size() + place, point);
  }

  const Se2& T_map_vehicle() const { return T_; }
  Eigen::MatrixXd StateCovariance() const { return P_.topLeftCorner(6, 6); }

 private:
  void Update(const Observation& observation, int landmark, const Eigen::Vector2d& point) {
    const Eigen::Index n = P_.rows();
    const Eigen::Index row = 8 + Eigen::Index{2} * landmark;
    const double scale = std::exp(scale_.z());
    Eigen::Matrix2d cov_z = ObservationNoise(observation, snapshot_.calibration().sensor);
    cov_z(0, 0) /= scale * scale;
    // z as a position: its errors turn and scale with where the landmark is expected.
    const Eigen::Vector2d q = T_.Inverse() * point;
    const double range = std::sqrt(q.squaredNorm() + cov_z(0, 0));
    const Eigen::Matrix2d turn = Eigen::Rotation2Dd(std::atan2(q.y(), q.x())).toRotationMatrix();
    const Eigen::Matrix2d dq_dz = turn * Eigen::Vector2d(1.0, range).asDiagonal();
    Observation position = observation;
    position.kind = Observation::Kind::kCartesian;
    position.z = observation.PositionInVehicle() / scale;
    const Innovation innovation = Linearize(position, T_, point);
    Eigen::MatrixXd H = Eigen::MatrixXd::Zero(2, n);
    H.leftCols<3>() = innovation.H_pose;
    H.col(5) = q;
    H.block<2, 2>(0, 6) = dq_dz;
    H.block<2, 2>(0, row) = innovation.H_landmark;
    const Eigen::Matrix2d R = dq_dz * cov_z * dq_dz.transpose();
    const Eigen::Matrix2d S = H * P_ * H.transpose() + R;
    Eigen::MatrixXd K = P_ * H.transpose() * S.inverse();
    if (schmidt_) K.bottomRows(n - 6).setZero();
    const Eigen::MatrixXd I_KH = Eigen::MatrixXd::Identity(n, n) - K * H;
    P_ = I_KH * P_ * I_KH.transpose() + K * R * K.transpose();
    const Eigen::VectorXd correction = K * (innovation.nu - H * error_);
    error_.tail(n - 6) += correction.tail(n - 6);
    const Se2 step = Se2::Exp(correction.head<3>());
    T_ = T_ * step;
    scale_ += correction.segment<3>(3);
    // The error of the map frame's origin stays what it is.
    Eigen::MatrixXd A = Eigen::MatrixXd::Identity(n, n);
    A.topLeftCorner<3, 3>() = step.Inverse().Adjoint();
    P_ = A * P_ * A.transpose();
  }

  const MapSnapshot& snapshot_;
  bool schmidt_;
  Se2 T_;
  Eigen::Vector2d bias_prior_;
  Eigen::VectorXd error_;  // Of bias, map and places; pose and scales are where theirs is zero.
  Eigen::Vector3d scale_ = Eigen::Vector3d::Zero();
  Eigen::MatrixXd P_;
};

TEST(KnownMapFilter, EqualsADenseSchmidtKalmanFilter) {
  // The heading stays so certain that the second order of q does not matter.
  MapContent content = CorrelatedMap(0.1, 0.05);
  content.calibration.odometry.noise_omega = 0.005;
  content.calibration.odometry.sd_log_scale = 0.005;
  const MapSnapshot snapshot = Snapshot(content);
  SimulationOptions options;
  options.duration_s = 20.0;
  const std::vector<int> states(content.groups.size(), 1);
  const SimulatedRun simulated = Simulate(content, PositionsOf(content, states), options);

  const PoseWithCovariance start{options.T_map_start,
                                 Eigen::Vector3d(0.01, 0.01, 0.0001).asDiagonal()};
  KnownMapFilter filter(start, content.calibration);
  DenseFilter dense(start, snapshot);
  OdometryBuffer odometry(content.calibration.odometry);
  for (const OdometrySample& sample : simulated.run.odometry) odometry.Add(sample);
  int updates = 0;
  for (const Scan& scan : simulated.run.scans) {
    const OdometryBuffer::Motion motion = odometry.Take(scan.stamp);
    filter.Predict(motion.increment, motion.elapsed_s);
    dense.Predict(motion.increment, motion.elapsed_s);
    for (const Observation& observation : scan.observations) {
      const ModeRef mode{snapshot.GroupIndex(observation.signature), 1};
      const Eigen::Matrix2d R = ObservationNoise(observation, content.calibration.sensor);
      filter.Update(filter.PredictObservation(observation, R, mode, snapshot), mode, snapshot);
      dense.Update(observation, mode);
      ++updates;
    }
  }
  ASSERT_GT(updates, 30);
  const Se2 difference = dense.T_map_vehicle().Inverse() * filter.T_map_vehicle();
  EXPECT_LT(difference.Log().norm(), 1e-9);
  EXPECT_LT((dense.StateCovariance() - filter.covariance()).norm(), 1e-9);
}

// The density of a position q seen by a vehicle whose pose is N(0, P) around the origin, and the
// mean yaw then. For a given yaw q is linear in the rest of ξ; the integral over yaw is a sum.
struct ExactSighting {
  ExactSighting(const Eigen::Matrix3d& P,
                const Eigen::Vector2d& p_map_landmark,
                const Eigen::Vector2d& q,
                const Eigen::Matrix2d& cov_q) {
    const Eigen::Vector2d regression = P.topRightCorner<2, 1>() / P(2, 2);
    const Eigen::Matrix2d rest =
        P.topLeftCorner<2, 2>() - regression * P.topRightCorner<2, 1>().transpose();
    const double sd = std::sqrt(P(2, 2));
    constexpr double kStep = 1e-3;
    for (double yaw = -6.0 * sd; yaw < 6.0 * sd; yaw += kStep) {
      // Exp(ξ)⁻¹ p for ξ = (ρ, yaw) is Rᵀ (p - V ρ).
      Eigen::Matrix2d V;
      V.col(0) = Se2::Exp({1.0, 0.0, yaw}).translation();
      V.col(1) = Se2::Exp({0.0, 1.0, yaw}).translation();
      const Eigen::Matrix2d R = Se2(0.0, 0.0, yaw).Rotation().transpose();
      const Eigen::Vector2d nu = q - R * (p_map_landmark - V * regression * yaw);
      const Eigen::Matrix2d RV = R * V;
      const Eigen::Matrix2d S = RV * rest * RV.transpose() + cov_q;
      const double weight =
          std::exp(LogGaussian(nu, S) - 0.5 * yaw * yaw / P(2, 2)) / sd / 2.506628274631;
      density += kStep * weight;
      mean_yaw += kStep * weight * yaw;
    }
    mean_yaw /= density;
  }

  double density = 0.0;
  double mean_yaw = 0.0;
};

// After a long drive by odometry alone the second order of q is larger than the sensor's errors.
TEST(KnownMapFilter, ASightingByAVaguePoseWeighsAsTheIntegralOverPoses) {
  MapContent content = CorrelatedMap(0.0, 0.05);
  Mode& mode = content.groups[0].modes[0];
  mode.p_map_landmark = {5.0, 1.0};
  const MapSnapshot snapshot = Snapshot(content);
  Eigen::Matrix3d P;
  P << 1.0, 0.0, 0.0, 0.0, 4.0, 0.5, 0.0, 0.5, 0.12;
  const KnownMapFilter before({Se2(), P}, content.calibration);
  const Eigen::Vector2d sd_z(content.calibration.sensor.sd_range_m,
                             content.calibration.sensor.sd_bearing_rad);
  const Eigen::Matrix2d cov_z = sd_z.cwiseAbs2().asDiagonal();
  for (const Eigen::Vector2d& q : {Eigen::Vector2d(5.0, 1.0),
                                   Eigen::Vector2d(6.0, 2.5),
                                   Eigen::Vector2d(4.0, -3.0),
                                   Eigen::Vector2d(5.5, 4.5)}) {
    Observation observation;
    observation.signature = content.groups[0].signature;
    observation.z = {q.norm(), std::atan2(q.y(), q.x())};
    const auto seen = KnownMapFilter::Measure(observation, cov_z);
    constexpr double kBias = 1.0 + KnownMapFilter::kBiasShare * KnownMapFilter::kBiasShare;
    const ExactSighting exact(
        P,
        mode.p_map_landmark,
        q,
        kBias * seen.cov_noise + mode.cov_p_map_landmark +
            std::pow(KnownMapFilter::kSdLogRangeScale, 2) * q * q.transpose());
    KnownMapFilter filter = before;
    const auto prediction = filter.PredictObservation(observation, cov_z, {0, 1}, snapshot);
    EXPECT_NEAR(filter.LogLikelihood(prediction, {0, 1}, snapshot) - seen.log_m2_per_unit,
                std::log(exact.density),
                0.15)
        << q.transpose();
    filter.Update(prediction, {0, 1}, snapshot);
    EXPECT_NEAR(filter.T_map_vehicle().yaw(), exact.mean_yaw, 0.03) << q.transpose();
    // And the landmark is then where it was seen.
    const auto after = filter.PredictPoint({0, 1}, snapshot);
    EXPECT_LT((after.q - filter.WithoutScale(seen).q).norm(), 0.06) << q.transpose();
  }
}

// What a position, a bias and a scale get wrong is in all sightings from where a vehicle stands:
// the next one is expected at the mean of those before, as exactly as if they were known.
TEST(KnownMapFilter, AnUnknownPlaceSharesTheErrorsOfThePose) {
  const MapContent content = CorrelatedMap(0.1, 0.05);
  const MapSnapshot map("area", VersionNumber(1), "hash", content);
  const PoseWithCovariance start{Se2(1.0, 2.0, 0.7),
                                 Eigen::Vector3d(0.04, 0.09, 1e-12).asDiagonal()};
  KnownMapFilter filter(start, content.calibration);
  const double variance = std::pow(content.calibration.sensor.sd_position_m, 2);
  const Eigen::Matrix2d R = Eigen::Matrix2d::Identity() * variance;
  std::mt19937_64 random(6);
  std::normal_distribution<double> normal(0.0, std::sqrt(variance));
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  for (int i = 0; i < 20; ++i) {
    Observation observation;
    observation.kind = Observation::Kind::kCartesian;
    observation.z = Eigen::Vector2d(4.0 + normal(random), -1.0 + normal(random));
    const KnownMapFilter::Measurement measurement = KnownMapFilter::Measure(observation, R);
    if (i == 0) {
      filter.StartPlace(3, measurement, Eigen::Vector2d::Zero());
    } else {
      const UnknownPlace& place = *filter.FindPlace(3);
      const KnownMapFilter::Prediction prediction = filter.PredictPlace(place, measurement);
      // A scale that is linearized elsewhere is not exactly shared.
      EXPECT_LT((prediction.point.q - mean).norm(), 0.03 * std::sqrt(variance));
      EXPECT_LT((prediction.S - R * (1.0 + 1.0 / i)).norm(), 1e-3 * variance);
      filter.UpdatePlace(place, prediction, map, 1.0, false);
    }
    mean += (observation.z - mean) / (i + 1.0);
  }
  EXPECT_EQ(filter.FindPlace(2), nullptr);
}

// A vehicle sees its map for a while, and then nothing but landmarks that moved.
TEST(KnownMapFilter, LandmarksKnownToHaveMovedCorrectThePoseAsIfMapAndPlacesWereEstimated) {
  MapContent content = CorrelatedMap(0.03, 0.02);
  content.calibration.odometry.noise_omega = 0.005;
  content.calibration.odometry.sd_log_scale = 0.005;
  content.calibration.sensor.sd_range_m = 0.02;
  content.calibration.sensor.sd_bearing_rad = 0.005;
  const MapSnapshot snapshot = Snapshot(content);
  SimulationOptions options;
  options.duration_s = 20.0;
  const std::vector<int> states(content.groups.size(), 1);
  std::vector<Eigen::Vector2d> places = PositionsOf(content, states);
  const SimulatedRun known = Simulate(content, places, options);
  for (Eigen::Vector2d& p : places) p += Eigen::Vector2d(1.0, -0.5);
  const SimulatedRun moved = Simulate(content, places, options);
  const PoseWithCovariance start{options.T_map_start,
                                 Eigen::Vector3d(1e-4, 1e-4, 1e-5).asDiagonal()};
  KnownMapFilter filter(start, content.calibration);
  KnownMapFilter by_odometry = filter;
  DenseFilter dense(start, snapshot, static_cast<int>(content.groups.size()), false);
  OdometryBuffer odometry(content.calibration.odometry);
  for (const OdometrySample& sample : known.run.odometry) odometry.Add(sample);
  const auto apart = [&](const KnownMapFilter& other) {
    return (dense.T_map_vehicle().translation() - other.T_map_vehicle().translation()).norm();
  };
  constexpr std::size_t kOnTheMap = 16;  // Scans.
  int by_places = 0;
  for (std::size_t i = 0; i < known.run.scans.size(); ++i) {
    const bool on_the_map = i < kOnTheMap;
    const Scan& scan = on_the_map ? known.run.scans[i] : moved.run.scans[i];
    const OdometryBuffer::Motion motion = odometry.Take(scan.stamp);
    for (KnownMapFilter* each : {&filter, &by_odometry}) {
      each->Predict(motion.increment, motion.elapsed_s);
    }
    dense.Predict(motion.increment, motion.elapsed_s);
    for (const Observation& observation : scan.observations) {
      const int group = snapshot.GroupIndex(observation.signature);
      const ModeRef mode{group, 1};
      const Eigen::Matrix2d R = ObservationNoise(observation, content.calibration.sensor);
      const KnownMapFilter::Measurement measurement = KnownMapFilter::Measure(observation, R);
      if (on_the_map) {
        for (KnownMapFilter* each : {&filter, &by_odometry}) {
          each->Update(each->PredictObservation(observation, R, mode, snapshot), mode, snapshot);
        }
        dense.Update(observation, mode);
      } else if (const UnknownPlace* const place = filter.FindPlace(group)) {
        const auto prediction = filter.PredictPlace(*place, measurement);
        const bool first = place->p_shared.isZero(0.0);
        dense.UpdatePlace(observation, group, first ? place->p_map_landmark : place->p_shared);
        filter.UpdatePlace(*place, prediction, snapshot, 1.0, true);
        ++by_places;
      } else {
        filter.StartPlace(group, measurement, Eigen::Vector2d::Zero());
      }
    }
    if (by_places > 0) {
      EXPECT_LT(apart(filter), 0.004);
    }
  }
  ASSERT_GT(by_places, 30);
  EXPECT_GT(apart(by_odometry), 0.1);
  const double sd = std::sqrt(dense.StateCovariance()(0, 0));
  EXPECT_NEAR(std::sqrt(filter.covariance()(0, 0)), sd, 0.02 * sd);
}

// Mean NEES of the final pose over runs in which map, scales, bias and noise are drawn from what
// the filter assumes, or assumes less of.
double MeanNees(int runs, double assumed_map_share) {
  double sum = 0.0;
  for (int seed = 0; seed < runs; ++seed) {
    const MapContent content = CorrelatedMap(0.10, 0.03);
    MapContent assumed = content;
    const int modes = content.covariance.size();
    SetCovariance(CorrelatedCovariance(modes, 0.10 * assumed_map_share, 0.03 * assumed_map_share),
                  &assumed);
    const MapSnapshot snapshot = Snapshot(assumed);

    std::mt19937_64 random(1000 + static_cast<std::uint64_t>(seed));
    std::normal_distribution<double> normal;
    const std::vector<int> states(content.groups.size(), 1);
    std::vector<Eigen::Vector2d> truth = PositionsOf(content, states);
    const Eigen::Vector2d shift(0.10 * normal(random), 0.10 * normal(random));
    for (Eigen::Vector2d& p : truth) {
      p += shift + 0.03 * Eigen::Vector2d(normal(random), normal(random));
    }
    SimulationOptions options;
    options.seed = 77 + static_cast<std::uint64_t>(seed);
    options.duration_s = 40.0;
    const SimulatedRun simulated = Simulate(content, truth, options);
    const Eigen::Vector3d error(0.1 * normal(random), 0.1 * normal(random), 0.05 * normal(random));
    KnownMapFilter filter(Start(Se2::Exp(error)), content.calibration);
    OdometryBuffer odometry(content.calibration.odometry);
    for (const OdometrySample& sample : simulated.run.odometry) odometry.Add(sample);
    for (const Scan& scan : simulated.run.scans) {
      const OdometryBuffer::Motion motion = odometry.Take(scan.stamp);
      filter.Predict(motion.increment, motion.elapsed_s);
      for (const Observation& observation : scan.observations) {
        const ModeRef mode{snapshot.GroupIndex(observation.signature), 1};
        const Eigen::Matrix2d R = ObservationNoise(observation, content.calibration.sensor);
        filter.Update(filter.PredictObservation(observation, R, mode, snapshot), mode, snapshot);
      }
    }
    const PoseWithCovariance pose = filter.Pose();
    const Eigen::Vector3d xi =
        (pose.T_map_vehicle.Inverse() * simulated.T_map_vehicle.back()).Log();
    sum += xi.dot(pose.cov_T_map_vehicle.inverse() * xi);
  }
  return sum / runs;
}

TEST(KnownMapFilter, IsConsistentOnAnUncertainMap) {
  constexpr int kRuns = 100;
  const double nees = MeanNees(kRuns, 1.0);
  EXPECT_GT(kRuns * nees, ChiSquareQuantile(0.025, 3 * kRuns)) << nees;
  EXPECT_LT(kRuns * nees, ChiSquareQuantile(0.975, 3 * kRuns)) << nees;
}

// Noise of the sensor must not enter the gain, where its product with the innovation has a mean:
// neither by dq/dz nor by where a vague pose is linearized.
TEST(KnownMapFilter, AStandingVehicleStaysWhereItIs) {
  MapContent content = CorrelatedMap(0.0, 0.02);
  content.calibration.sensor.sd_range_m = 0.1;
  content.calibration.sensor.sd_bearing_rad = 0.02;
  const Eigen::Vector2d q(6.7, 2.1);
  content.groups[0].modes[0].p_map_landmark = q;
  const MapSnapshot snapshot = Snapshot(content);
  for (const double sd : {0.03, 0.3}) {
    double nees = 0.0;
    constexpr int kRuns = 20;
    for (std::uint64_t seed = 1; seed <= kRuns; ++seed) {
      std::mt19937_64 random(seed);
      std::normal_distribution<double> normal;
      const Se2 start =
          Se2::Exp({sd * normal(random), sd * normal(random), 0.3 * sd * normal(random)});
      KnownMapFilter filter({start, Eigen::Vector3d(sd * sd, sd * sd, 0.09 * sd * sd).asDiagonal()},
                            content.calibration);
      for (int scan = 0; scan < 3000; ++scan) {
        MotionIncrement stands;
        stands.cov = 1e-10 * Eigen::Matrix3d::Identity();
        filter.Predict(stands, 0.25);
        Observation seen;
        seen.kind = Observation::Kind::kRangeBearing;
        seen.z = {q.norm() + 0.1 * normal(random),
                  std::atan2(q.y(), q.x()) + 0.02 * normal(random)};
        const Eigen::Matrix2d R = ObservationNoise(seen, content.calibration.sensor);
        filter.Update(filter.PredictObservation(seen, R, {0, 1}, snapshot), {0, 1}, snapshot);
      }
      const PoseWithCovariance pose = filter.Pose();
      nees += SquaredMahalanobis(pose.T_map_vehicle, Se2(), pose.cov_T_map_vehicle) / kRuns;
    }
    EXPECT_LT(nees, 4.2) << sd;  // χ²(3), and two deviations of its mean.
  }
}

// NEES of a vehicle that stands before `modes` landmarks of the map and one that moved.
// @param kinds  Of observations: 2 if every second landmark is seen as a position.
double NeesBesideAMovedLandmark(int modes, int kinds, std::uint64_t seed) {
  MapContent content = CorrelatedMap(0.1, 0.1, modes + 1);
  content.calibration.sensor.sd_range_m = content.calibration.sensor.sd_position_m = 0.05;
  content.calibration.sensor.sd_bearing_rad = 0.01;
  const MapSnapshot snapshot = Snapshot(content);
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  const auto draw = [&](double sd) -> Eigen::Vector2d {
    return sd * Eigen::Vector2d(normal(random), normal(random));
  };
  const Eigen::Vector2d shift = draw(0.1);
  std::vector<Eigen::Vector2d> truth = PositionsOf(content, std::vector<int>(modes + 1, 1));
  for (Eigen::Vector2d& p : truth) p += shift + draw(0.1);
  truth.back() += Eigen::Vector2d(1.5, -1.0);
  const Se2 T_map_vehicle =
      Se2::Exp({0.1 * normal(random), 0.1 * normal(random), 0.05 * normal(random)});
  const Eigen::Vector2d sd_z(0.05, 0.01);
  const Eigen::Vector2d bias = KnownMapFilter::kBiasShare * draw(1.0).cwiseProduct(sd_z);
  const Eigen::Vector2d position_bias = draw(KnownMapFilter::kBiasShare * 0.05);
  const double range_scale = std::exp(KnownMapFilter::kSdLogRangeScale * normal(random));
  KnownMapFilter filter(Start(Se2()), content.calibration);
  for (int scan = 0; scan < 60; ++scan) {
    MotionIncrement stands;
    stands.cov = 1e-10 * Eigen::Matrix3d::Identity();
    filter.Predict(stands, 0.1);
    for (int group = 0; group <= modes; ++group) {
      const Eigen::Vector2d q =
          range_scale * (T_map_vehicle.Inverse() * truth[static_cast<std::size_t>(group)]);
      Observation seen;
      if (group % kinds == 1) {
        seen.kind = Observation::Kind::kCartesian;
        seen.z = q + position_bias + draw(0.05);
      } else {
        seen.kind = Observation::Kind::kRangeBearing;
        seen.z = Eigen::Vector2d(q.norm(), std::atan2(q.y(), q.x())) + bias +
                 draw(1.0).cwiseProduct(sd_z);
      }
      const Eigen::Matrix2d R = ObservationNoise(seen, content.calibration.sensor);
      const ModeRef mode{group, 1};
      const KnownMapFilter::Measurement measurement = KnownMapFilter::Measure(seen, R);
      if (group < modes) {
        filter.Update(filter.PredictObservation(seen, R, mode, snapshot), mode, snapshot);
      } else if (const UnknownPlace* const place = filter.FindPlace(group)) {
        const auto prediction = filter.PredictPlace(*place, measurement);
        filter.UpdatePlace(*place, prediction, snapshot, 1.0, true);
      } else {
        filter.StartPlace(group, measurement, Eigen::Vector2d::Zero());
      }
    }
  }
  return SquaredMahalanobis(filter.T_map_vehicle(), T_map_vehicle, filter.Pose().cov_T_map_vehicle);
}

// More modes in view than SharedErrors hold, and two kinds of observations: what goes from there
// comes back as what it is known to be, and does not count anew.
TEST(KnownMapFilter, IsConsistentBesideALandmarkThatMoved) {
  constexpr int kDraws = 100;
  for (const auto& [modes, kinds] :
       {std::pair{8, 1}, {SharedErrors::kMaxModes + 2, 1}, {20, 1}, {6, 2}}) {
    double nees = 0.0;
    for (std::uint64_t seed = 1; seed <= kDraws; ++seed) {
      nees += NeesBesideAMovedLandmark(modes, kinds, seed) / kDraws;
    }
    EXPECT_GT(nees, 2.2) << modes << ' ' << kinds;  // χ²(3), less three deviations of its mean.
    EXPECT_LT(nees, 4.5) << modes << ' ' << kinds;
  }
}

// A sensor of a micrometre takes the last digits of what is known together.
TEST(KnownMapFilter, StaysSoundWhereAPlaceTakesTheLastDigits) {
  const MapContent content = CorrelatedMap(0.1, 0.05);
  const MapSnapshot snapshot = Snapshot(content);
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> exponent(-12.0, -2.0);
  for (int run = 0; run < 300; ++run) {
    const double sd = std::pow(10.0, exponent(random) / 4.0);
    const PoseWithCovariance start{
        Se2(), Eigen::Vector3d(sd * sd, sd * sd, std::pow(10.0, exponent(random))).asDiagonal()};
    KnownMapFilter filter(start, content.calibration);
    const Eigen::Matrix2d R =
        Eigen::Vector2d(std::pow(10.0, exponent(random)), std::pow(10.0, exponent(random)))
            .asDiagonal();
    Observation seen;
    seen.kind = run % 2 == 0 ? Observation::Kind::kCartesian : Observation::Kind::kRangeBearing;
    seen.z = Eigen::Vector2d(3.0, 0.5);
    const KnownMapFilter::Measurement measurement = KnownMapFilter::Measure(seen, R);
    filter.StartPlace(3, measurement, Eigen::Vector2d::Zero());
    for (int i = 0; i < 30; ++i) {
      const UnknownPlace* const place = filter.FindPlace(3);
      if (place == nullptr) break;
      filter.UpdatePlace(*place, filter.PredictPlace(*place, measurement), snapshot, 1.0, true);
      const PoseWithCovariance pose = filter.Pose();
      ASSERT_TRUE(IsSymmetricPositiveDefinite(pose.cov_T_map_vehicle)) << run << ' ' << i;
      ASSERT_LT(pose.T_map_vehicle.translation().norm(), 1.0) << run << ' ' << i;
    }
  }
}

TEST(KnownMapFilter, WouldBeOverconfidentIfTheMapWereExact) {
  constexpr int kRuns = 50;
  EXPECT_GT(kRuns * MeanNees(kRuns, 0.01), ChiSquareQuantile(0.999, 3 * kRuns));
}

TEST(KnownMapFilter, LearnsTheScaleOfTheOdometry) {
  MapContent content = CorrelatedMap(0.01, 0.01);
  const std::vector<int> states(content.groups.size(), 1);
  SimulationOptions options;
  options.duration_s = 120.0;
  MapContent truth = content;
  truth.calibration.odometry.sd_log_scale = 1e-6;
  truth.calibration.odometry.scale_omega = 0.9;
  const SimulatedRun simulated = Simulate(truth, PositionsOf(content, states), options);
  const MapSnapshot snapshot = Snapshot(content);
  KnownMapFilter filter(Start(Se2()), content.calibration);
  OdometryBuffer odometry(content.calibration.odometry);
  for (const OdometrySample& sample : simulated.run.odometry) odometry.Add(sample);
  for (const Scan& scan : simulated.run.scans) {
    const OdometryBuffer::Motion motion = odometry.Take(scan.stamp);
    filter.Predict(motion.increment, motion.elapsed_s);
    for (const Observation& observation : scan.observations) {
      const ModeRef mode{snapshot.GroupIndex(observation.signature), 1};
      const Eigen::Matrix2d R = ObservationNoise(observation, content.calibration.sensor);
      filter.Update(filter.PredictObservation(observation, R, mode, snapshot), mode, snapshot);
    }
  }
  EXPECT_NEAR(filter.log_scale().y(), std::log(0.9), 0.04);
}

TEST(OdometryBuffer, IntegratesLikeTheBatchModel) {
  OdometryCalibration calibration;
  calibration.lag_s = 0.13;
  calibration.scale_v = 0.9;
  std::vector<OdometrySample> samples;
  const Stamp begin = StampFromSeconds(50.0);
  for (int i = 0; i < 400; ++i) {
    samples.push_back({begin + FromSeconds(0.03 * i), 0.3 + 0.1 * (i % 7), 0.05 * (i % 11)});
  }
  OdometryBuffer buffer(calibration);
  std::size_t next = 0;
  std::size_t hint = 0;
  Stamp last = begin + FromSeconds(1.0);
  for (const double at_s : {1.0, 1.37, 2.0, 2.01, 7.5, 11.0}) {
    const Stamp stamp = begin + FromSeconds(at_s);
    for (; next < samples.size() && samples[next].stamp <= stamp; ++next) {
      buffer.Add(samples[next]);
    }
    const OdometryBuffer::Motion motion = buffer.Take(stamp);
    const MotionIncrement batch = IntegrateMotion(samples, last, stamp, calibration, &hint);
    EXPECT_NEAR(motion.elapsed_s, ToSeconds(stamp - last), 1e-12);
    EXPECT_LT((batch.T_begin_end.Inverse() * motion.increment.T_begin_end).Log().norm(), 1e-9);
    EXPECT_LT((batch.cov - motion.increment.cov).norm(), 1e-9);
    last = stamp;
  }
}

TEST(OdometryBuffer, DoesNotTrustSilence) {
  OdometryBuffer buffer(OdometryCalibration{});
  const Stamp begin = StampFromSeconds(50.0);
  buffer.Take(begin);
  buffer.Add({begin, 3.0, 0.0});
  const OdometryBuffer::Motion motion = buffer.Take(begin + FromSeconds(5.0));
  EXPECT_NEAR(motion.increment.T_begin_end.x(), 3.0, 1e-9);  // Held for a second, then unknown.
  EXPECT_NEAR(motion.silent_s, 4.0, 1e-9);
  // The vehicle may have gone on at 3 m/s in any direction.
  EXPECT_GT(motion.increment.cov(0, 0), 144.0);
  EXPECT_GT(motion.increment.cov(1, 1), 144.0);
  EXPECT_LT(motion.increment.cov(0, 0), 150.0);
}

// The speed may be another one in each part.
TEST(OdometryBuffer, AnUnknownWayBeginsWhereLandmarksDetermineThePose) {
  const Stamp begin = StampFromSeconds(50.0);
  OdometryBuffer buffer(OdometryCalibration{});
  buffer.Take(begin);
  for (int i = 1; i <= 100; ++i) {
    const OdometryBuffer::Motion step = buffer.Take(begin + FromSeconds(0.1 * i));
    EXPECT_NEAR(step.silent_s, 0.1 * i, 1e-9);
    EXPECT_LT(step.increment.cov(0, 0), 0.1);  // 0.2 m at 2 m/s.
    EXPECT_GT(step.increment.cov(0, 0), 0.04);
    buffer.PoseDetermined();
  }
}

TEST(OdometryBuffer, OdometryThatIsNotTrustedIsAsGoodAsSilence) {
  const Stamp begin = StampFromSeconds(50.0);
  OdometryBuffer buffer(OdometryCalibration{});
  buffer.Take(begin);
  buffer.Add({begin, 3.0, 0.2});
  for (int i = 0; i < 200; ++i) buffer.Add({begin + FromSeconds(0.1 * i), 0.0, 0.2});
  const OdometryBuffer::Motion good = buffer.Take(begin + FromSeconds(5.0));
  buffer.Trust(false);
  const OdometryBuffer::Motion bad = buffer.Take(begin + FromSeconds(10.0));
  buffer.Trust(true);
  const OdometryBuffer::Motion good_again = buffer.Take(begin + FromSeconds(15.0));
  EXPECT_EQ(bad.silent_s, 0.0);
  EXPECT_LT((good.increment.T_begin_end.Inverse() * bad.increment.T_begin_end).Log().norm(), 1e-9);
  EXPECT_LT((good.increment.cov - good_again.increment.cov).norm(), 1e-9);
  EXPECT_GT(bad.increment.cov(0, 0), 25.0);  // 5 m at 1 m/s, although it says 0.
  EXPECT_GT(bad.increment.cov(2, 2), 1.0);
}

TEST(OdometryBuffer, ASilenceIsTheSameInManySteps) {
  const Stamp begin = StampFromSeconds(50.0);
  OdometryBuffer whole(OdometryCalibration{});
  OdometryBuffer steps(OdometryCalibration{});
  for (OdometryBuffer* buffer : {&whole, &steps}) {
    buffer->Take(begin);
    buffer->Add({begin, 2.0, 0.0});
    buffer->Take(begin + FromSeconds(1.0));
  }
  const OdometryBuffer::Motion at_once = whole.Take(begin + FromSeconds(4.0));
  Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
  for (const double seconds : {1.2, 2.0, 2.1, 3.7, 4.0}) {
    const OdometryBuffer::Motion step = steps.Take(begin + FromSeconds(seconds));
    EXPECT_NEAR(step.silent_s, seconds - 1.0, 1e-9);
    sum += step.increment.cov;
  }
  EXPECT_LT((sum - at_once.increment.cov).norm(), 1e-9);
  steps.Add({begin + FromSeconds(4.0), 2.0, 0.0});
  EXPECT_EQ(steps.Take(begin + FromSeconds(4.5)).silent_s, 0.0);
}

TEST(KnownMapFilter, ObservationFarOutOfReachGatesWithNothing) {
  const MapSnapshot snapshot = Snapshot(CorrelatedMap(0.1, 0.1));
  const Eigen::Matrix2d cov_z = Eigen::Vector2d(0.0225, 0.0009).asDiagonal();
  for (int i = 0; i < 90; ++i) {
    KnownMapFilter filter(Start(Se2(0.1 * i, -0.2, 0.3 * i)), snapshot.calibration());
    Observation observation;
    observation.z = {1e9, 0.07 * i - 3.0};
    for (int update = 0; update < 3; ++update) {
      const auto prediction = filter.PredictObservation(observation, cov_z, {i % 8, 1}, snapshot);
      ASSERT_GE(prediction.nis, 0.0);
      ASSERT_EQ(prediction.usable(), std::isfinite(prediction.LogLikelihood()));
      ASSERT_FALSE(std::isnan(filter.LogLikelihood(prediction, {i % 8, 1}, snapshot)));
      if (prediction.usable()) filter.Update(prediction, {i % 8, 1}, snapshot);
      ASSERT_TRUE(IsSymmetricPositiveDefinite(filter.Pose().cov_T_map_vehicle));
    }
  }
}

TEST(KnownMapFilter, StartsAnewWhereNumbersHaveNoDigitsLeft) {
  const MapSnapshot snapshot = Snapshot(CorrelatedMap(0.1, 0.1));
  PoseWithCovariance start = Start(Se2(1.0, 2.0, 0.5));
  KnownMapFilter filter(start, snapshot.calibration());
  EXPECT_FALSE(IsNowhere(filter.Pose()));
  MotionIncrement far;
  far.T_begin_end = Se2(1e9, 0.0, 0.0);
  filter.Predict(far, 1.0);
  EXPECT_TRUE(IsNowhere(filter.Pose()));
  start.cov_T_map_vehicle.setConstant(std::numeric_limits<double>::quiet_NaN());
  EXPECT_TRUE(IsNowhere(KnownMapFilter(start, snapshot.calibration()).Pose()));
  start.cov_T_map_vehicle = Eigen::Matrix3d::Identity() * 1e18;
  start.T_map_vehicle = Se2(1e300, 0.0, 0.0);
  const PoseWithCovariance pose = KnownMapFilter(start, snapshot.calibration()).Pose();
  EXPECT_TRUE(IsNowhere(pose));
  EXPECT_TRUE(pose.T_map_vehicle.translation().allFinite());
}

}  // namespace
}  // namespace shiftmap
