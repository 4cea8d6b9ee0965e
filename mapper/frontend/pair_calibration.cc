// SPDX-License-Identifier: Apache-2.0
#include "mapper/frontend/pair_calibration.h"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <utility>

#include "localizer/models/observation_model.h"
#include "mapper/frontend/frame_motions.h"
#include "mapstore/core/median.h"
#include "mapstore/geometry/angle.h"

namespace shiftmap {
namespace {

// Between the two sightings of a pair: in less time the vehicle hardly moves. [s]
constexpr double kMinPairSeconds = 0.2;
constexpr double kMaxPairSeconds = 2.0;
constexpr std::size_t kMinPairs = 30;      // Fewer do not determine scales and lag.
constexpr std::size_t kMaxPairs = 750;     // Of more, these are taken evenly.
constexpr std::size_t kCoarsePairs = 250;  // To find the lag on the grid.
constexpr double kCauchyScale = 2.0;       // In standard deviations.

// Lags are sought to this. [s]
constexpr double kMaxLag = 0.6;

// A vehicle that moves less stands. [m], [rad]
constexpr double kMinWay = 0.01;
constexpr double kMinTurn = 0.01;

// No sensor is found to be better than that. [m], [rad]
constexpr double kMinSd = 1e-3;

struct SightingPair {
  Stamp begin;
  Stamp end;
  const Observation* observation_begin;
  const Observation* observation_end;
  Eigen::Vector2d q_begin;  // Landmark in the vehicle frame. [m]
  Eigen::Vector2d q_end;
  Eigen::Matrix2d information;  // Of q_end - Exp(Sξ)⁻¹ q_begin. [1/m²]
};

// The dead-reckoned path of a run; the vehicle's twist between any two times is read off it.
class DeadReckoning {
 public:
  explicit DeadReckoning(const std::vector<OdometrySample>& odometry) : odometry_(odometry) {
    poses_.push_back(Se2());
    for (std::size_t i = 1; i < odometry.size(); ++i) {
      poses_.push_back(poses_.back() *
                       Arc(odometry[i - 1], odometry[i].stamp - odometry[i - 1].stamp));
    }
  }

  // Whether odometry says at all times from `begin` to `end` how the vehicle moves.
  bool Measures(Stamp begin, Stamp end) const {
    if (begin < odometry_.front().stamp) return false;
    auto sample = Next(begin);
    Stamp said = (sample - 1)->stamp;
    for (; sample != odometry_.end() && sample->stamp < end; ++sample) {
      if (sample->stamp - said > FromSeconds(kOdometryFresh)) return false;
      said = sample->stamp;
    }
    return end - said <= FromSeconds(kOdometryFresh);
  }

  Eigen::Vector3d Twist(Stamp begin, Stamp end) const {
    return (PoseAt(begin).Inverse() * PoseAt(end)).Log();
  }

 private:
  static Se2 Arc(const OdometrySample& sample, Duration elapsed) {
    const double dt = ToSeconds(elapsed);
    return Se2::Exp({sample.v_mps * dt, 0.0, sample.omega_radps * dt});
  }

  // The first sample after a time.
  std::vector<OdometrySample>::const_iterator Next(Stamp stamp) const {
    return std::upper_bound(
        odometry_.begin(), odometry_.end(), stamp, [](Stamp wanted, const OdometrySample& sample) {
          return wanted < sample.stamp;
        });
  }

  Se2 PoseAt(Stamp stamp) const {
    const auto next = Next(stamp);
    if (next == odometry_.begin()) return poses_.front();
    const auto i = static_cast<std::size_t>(next - odometry_.begin()) - 1;
    return poses_[i] * Arc(odometry_[i], stamp - odometry_[i].stamp);
  }

  const std::vector<OdometrySample>& odometry_;
  std::vector<Se2> poses_;
};

// Which sighting a sighting makes a pair with, of those from kMinPairSeconds to kMaxPairSeconds
// ago.
enum class Partner { kFirst, kLast };

// Pairs between which odometry says how the vehicle moved, at all lags of the search.
std::vector<SightingPair> CollectPairs(const MappingRun& run,
                                       const DeadReckoning& path,
                                       const SensorCalibration& sensor,
                                       Partner partner) {
  std::vector<SightingPair> pairs;
  for (const MappingVisit& visit : run.visits) {
    const auto sighting_of = [&](std::size_t index) -> const Sighting& {
      return run.sightings[visit.sightings[index]];
    };
    const auto stamp_of = [&](std::size_t index) {
      return run.frames[sighting_of(index).frame].stamp;
    };
    std::size_t first = 0;
    for (std::size_t second = 1; second < visit.sightings.size(); ++second) {
      const Stamp end = stamp_of(second);
      const auto seconds_since = [&](std::size_t index) {
        return ToSeconds(end - stamp_of(index));
      };
      while (first < second && seconds_since(first) > kMaxPairSeconds) ++first;
      if (partner == Partner::kLast) {
        while (first + 1 < second && seconds_since(first + 1) >= kMinPairSeconds) ++first;
      }
      if (first == second || seconds_since(first) < kMinPairSeconds) continue;
      const Duration lag = FromSeconds(kMaxLag);
      if (!path.Measures(stamp_of(first) - lag, end + lag)) continue;
      const Observation& a = sighting_of(first).observation;
      const Observation& b = sighting_of(second).observation;
      const Eigen::Matrix2d cov = PositionNoiseInVehicle(a, ObservationNoise(a, sensor)) +
                                  PositionNoiseInVehicle(b, ObservationNoise(b, sensor));
      pairs.push_back({stamp_of(first),
                       end,
                       &a,
                       &b,
                       a.PositionInVehicle(),
                       b.PositionInVehicle(),
                       cov.inverse()});
    }
  }
  return pairs;
}

std::vector<SightingPair> Thinned(const std::vector<SightingPair>& pairs, std::size_t count) {
  if (pairs.size() <= count) return pairs;
  std::vector<SightingPair> thinned;
  for (std::size_t i = 0; i < count; ++i) thinned.push_back(pairs[i * pairs.size() / count]);
  return thinned;
}

struct ScaleFit {
  Eigen::Vector2d log_scale = Eigen::Vector2d::Zero();
  double cost = 0.0;
};

std::vector<Eigen::Vector3d> TwistsOf(const std::vector<SightingPair>& pairs,
                                      const DeadReckoning& path,
                                      double lag_s) {
  const Duration lag = FromSeconds(lag_s);
  std::vector<Eigen::Vector3d> twists;
  for (const SightingPair& pair : pairs) {
    twists.push_back(path.Twist(pair.begin - lag, pair.end - lag));
  }
  return twists;
}

Eigen::Vector3d Scaled(const Eigen::Vector3d& twist, const Eigen::Vector2d& log_scale) {
  const Eigen::Array2d scale = log_scale.array().exp();
  return {scale.x() * twist.x(), scale.x() * twist.y(), scale.y() * twist.z()};
}

// Gauss-Newton over (log scale_v, log scale_omega) with a Cauchy loss, at a fixed lag.
ScaleFit FitScales(const std::vector<SightingPair>& pairs,
                   const std::vector<Eigen::Vector3d>& twists,
                   const Eigen::Vector2d& start,
                   const OdometryCalibration& prior) {
  constexpr int kIterations = 5;
  constexpr double kSettled = 1e-3;  // A step shorter than this leaves the cost as it is.
  const double prior_information = 1.0 / (prior.sd_log_scale * prior.sd_log_scale);
  const Eigen::Vector2d prior_mean(std::log(prior.scale_v), std::log(prior.scale_omega));
  ScaleFit fit{start, 0.0};
  for (int iteration = 0;; ++iteration) {
    Eigen::Matrix2d H = Eigen::Matrix2d::Identity() * prior_information;
    Eigen::Vector2d g = prior_information * (prior_mean - fit.log_scale);
    fit.cost = 0.5 * prior_information * (prior_mean - fit.log_scale).squaredNorm();
    for (std::size_t i = 0; i < pairs.size(); ++i) {
      const Eigen::Vector3d twist = Scaled(twists[i], fit.log_scale);
      const Se2::Step step = Se2::ExpStep(twist);
      const Eigen::Vector2d predicted =
          step.inverse_adjoint.topLeftCorner<2, 2>() * (pairs[i].q_begin - step.T.translation());
      const Eigen::Vector2d residual = pairs[i].q_end - predicted;
      // d predicted / dξ for Exp(Sξ)·Exp(dξ), as in the observation model.
      Eigen::Matrix<double, 2, 3> dq;
      dq << -1.0, 0.0, predicted.y(), 0.0, -1.0, -predicted.x();
      const Eigen::Matrix<double, 2, 3> dtwist = dq * step.right_jacobian;
      Eigen::Matrix2d J;
      J.col(0) = dtwist.leftCols<2>() * twist.head<2>();
      J.col(1) = dtwist.col(2) * twist.z();
      const double squared =
          residual.dot(pairs[i].information * residual) / (kCauchyScale * kCauchyScale);
      const double weight = 1.0 / (1.0 + squared);
      H += weight * J.transpose() * pairs[i].information * J;
      g += weight * J.transpose() * pairs[i].information * residual;
      fit.cost += 0.5 * kCauchyScale * kCauchyScale * std::log1p(squared);
    }
    if (iteration == kIterations) return fit;
    const Eigen::Vector2d step = H.inverse() * g;
    fit.log_scale += step;
    if (step.norm() < kSettled) return fit;
  }
}

// Scales at the lag that fits best.
OdometryCalibration FitOdometry(const std::vector<SightingPair>& pairs,
                                const DeadReckoning& path,
                                const OdometryCalibration& fallback) {
  constexpr double kLagStep = 0.1;  // [s]
  constexpr double kMinLag = -kMaxLag;
  const std::vector<SightingPair> coarse = Thinned(pairs, kCoarsePairs);
  Eigen::Vector2d start(std::log(fallback.scale_v), std::log(fallback.scale_omega));
  std::array<double, 13> cost{};
  for (std::size_t i = 0; i < cost.size(); ++i) {
    const double lag_s = kMinLag + kLagStep * static_cast<double>(i);
    const ScaleFit fit = FitScales(coarse, TwistsOf(coarse, path, lag_s), start, fallback);
    start = fit.log_scale;
    cost[i] = fit.cost + 0.5 * std::pow((lag_s - fallback.lag_s) / kLagSd, 2);
  }
  const auto best =
      static_cast<std::size_t>(std::min_element(cost.begin(), cost.end()) - cost.begin());
  double lag_s = kMinLag + kLagStep * static_cast<double>(best);
  if (best > 0 && best + 1 < cost.size()) {
    const double curvature = cost[best - 1] - 2.0 * cost[best] + cost[best + 1];
    if (curvature > 0.0) lag_s += 0.5 * kLagStep * (cost[best - 1] - cost[best + 1]) / curvature;
  }
  const ScaleFit fit = FitScales(pairs, TwistsOf(pairs, path, lag_s), start, fallback);
  OdometryCalibration calibration = fallback;
  calibration.scale_v = std::exp(fit.log_scale.x());
  calibration.scale_omega = std::exp(fit.log_scale.y());
  calibration.lag_s = lag_s;
  return calibration;
}

// Replaces *sd by the noise of each of two values that differ by `differences`.
void TakeNoise(std::vector<double> differences, double* sd) {
  if (differences.size() < kMinPairs) return;
  constexpr double kSdPerMedian = 1.4826;  // Of the magnitude of a Gaussian.
  *sd = std::max(kMinSd, kSdPerMedian / std::numbers::sqrt2 * Median(std::move(differences)));
}

// What remains between a sighting and one shortly after, of a vehicle that moves.
SensorCalibration FitSensor(const std::vector<SightingPair>& pairs,
                            const DeadReckoning& path,
                            const OdometryCalibration& odometry,
                            const SensorCalibration& fallback) {
  const Eigen::Vector2d log_scale(std::log(odometry.scale_v), std::log(odometry.scale_omega));
  const std::vector<Eigen::Vector3d> twists = TwistsOf(pairs, path, odometry.lag_s);
  std::vector<double> range;
  std::vector<double> bearing;
  std::vector<double> position;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const SightingPair& pair = pairs[i];
    const Observation& begin = *pair.observation_begin;
    const Observation& end = *pair.observation_end;
    if (begin.cov_z || end.cov_z || begin.kind != end.kind) continue;
    // At standstill many sensors read the same again.
    if (twists[i].head<2>().norm() < kMinWay && std::abs(twists[i].z()) < kMinTurn) continue;
    const Eigen::Vector2d predicted =
        Se2::Exp(Scaled(twists[i], log_scale)).Inverse() * pair.q_begin;
    if (end.kind == Observation::Kind::kCartesian) {
      for (const double difference : Eigen::Vector2d(pair.q_end - predicted)) {
        position.push_back(std::abs(difference));
      }
    } else {
      range.push_back(std::abs(end.z.x() - predicted.norm()));
      bearing.push_back(std::abs(WrapAngle(end.z.y() - std::atan2(predicted.y(), predicted.x()))));
    }
  }
  SensorCalibration sensor = fallback;
  TakeNoise(std::move(range), &sensor.sd_range_m);
  TakeNoise(std::move(bearing), &sensor.sd_bearing_rad);
  TakeNoise(std::move(position), &sensor.sd_position_m);
  return sensor;
}

}  // namespace

Calibration CalibrateFromPairs(const MappingRun& run, const Calibration& fallback) {
  const DeadReckoning path(run.odometry);
  const auto pairs_with = [&](Partner partner) {
    return Thinned(CollectPairs(run, path, fallback.sensor, partner), kMaxPairs);
  };
  const std::vector<SightingPair> pairs = pairs_with(Partner::kFirst);
  if (pairs.size() < kMinPairs) return fallback;
  Calibration calibration = fallback;
  calibration.odometry = FitOdometry(pairs, path, fallback.odometry);
  calibration.sensor =
      FitSensor(pairs_with(Partner::kLast), path, calibration.odometry, fallback.sensor);
  return calibration;
}

}  // namespace shiftmap
