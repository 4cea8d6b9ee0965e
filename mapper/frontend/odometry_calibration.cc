// SPDX-License-Identifier: Apache-2.0
#include "mapper/frontend/odometry_calibration.h"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>

#include "localizer/models/motion_model.h"
#include "localizer/models/observation_model.h"

namespace shiftmap {
namespace {

constexpr double kMinPairSeconds = 0.2;
constexpr double kMaxPairSeconds = 2.0;
constexpr std::size_t kMinPairs = 30;
constexpr std::size_t kMaxPairs = 1500;
constexpr std::size_t kCoarsePairs = 250;  // To find the lag on the grid.
constexpr double kCauchyScale = 2.0;

struct SightingPair {
  Stamp begin;
  Stamp end;
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

  Eigen::Vector3d Twist(Stamp begin, Stamp end) const {
    return (PoseAt(begin).Inverse() * PoseAt(end)).Log();
  }

 private:
  static Se2 Arc(const OdometrySample& sample, Duration elapsed) {
    const double dt = ToSeconds(elapsed);
    return Se2::Exp({sample.v_mps * dt, 0.0, sample.omega_radps * dt});
  }

  Se2 PoseAt(Stamp stamp) const {
    const auto next = std::upper_bound(
        odometry_.begin(), odometry_.end(), stamp, [](Stamp wanted, const OdometrySample& sample) {
          return wanted < sample.stamp;
        });
    if (next == odometry_.begin()) return poses_.front();
    const auto i = static_cast<std::size_t>(next - odometry_.begin()) - 1;
    return poses_[i] * Arc(odometry_[i], stamp - odometry_[i].stamp);
  }

  const std::vector<OdometrySample>& odometry_;
  std::vector<Se2> poses_;
};

std::vector<SightingPair> CollectPairs(const MappingRun& run, const SensorCalibration& sensor) {
  std::vector<SightingPair> pairs;
  for (const MappingVisit& visit : run.visits) {
    std::size_t first = 0;
    for (std::size_t second = 1; second < visit.sightings.size(); ++second) {
      const Sighting& b = run.sightings[static_cast<std::size_t>(visit.sightings[second])];
      const Stamp end = run.frames[static_cast<std::size_t>(b.frame)].stamp;
      const auto stamp_of = [&](std::size_t index) {
        const Sighting& sighting = run.sightings[static_cast<std::size_t>(visit.sightings[index])];
        return run.frames[static_cast<std::size_t>(sighting.frame)].stamp;
      };
      while (first < second && ToSeconds(end - stamp_of(first)) > kMaxPairSeconds) ++first;
      if (first == second || ToSeconds(end - stamp_of(first)) < kMinPairSeconds) continue;
      const Sighting& a = run.sightings[static_cast<std::size_t>(visit.sightings[first])];
      const Eigen::Matrix2d cov =
          PositionNoiseInVehicle(a.observation, ObservationNoise(a.observation, sensor)) +
          PositionNoiseInVehicle(b.observation, ObservationNoise(b.observation, sensor));
      pairs.push_back({stamp_of(first),
                       end,
                       a.observation.PositionInVehicle(),
                       b.observation.PositionInVehicle(),
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

// Gauss-Newton over (log scale_v, log scale_omega) with a Cauchy loss, at a fixed lag.
ScaleFit FitScales(const std::vector<SightingPair>& pairs,
                   const std::vector<Eigen::Vector3d>& twists,
                   const OdometryCalibration& prior) {
  constexpr int kIterations = 5;
  constexpr double kSettled = 1e-4;  // A step shorter than this leaves the cost as it is.
  const double prior_information = 1.0 / (prior.sd_log_scale * prior.sd_log_scale);
  const Eigen::Vector2d prior_mean(std::log(prior.scale_v), std::log(prior.scale_omega));
  ScaleFit fit{prior_mean, 0.0};
  for (int iteration = 0;; ++iteration) {
    Eigen::Matrix2d H = Eigen::Matrix2d::Identity() * prior_information;
    Eigen::Vector2d g = prior_information * (prior_mean - fit.log_scale);
    fit.cost = 0.5 * prior_information * (prior_mean - fit.log_scale).squaredNorm();
    const Eigen::Array2d scale = fit.log_scale.array().exp();
    for (std::size_t i = 0; i < pairs.size(); ++i) {
      const Eigen::Vector3d twist(
          scale.x() * twists[i].x(), scale.x() * twists[i].y(), scale.y() * twists[i].z());
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

}  // namespace

OdometryCalibration EstimateOdometryFromPairs(const MappingRun& run,
                                              const SensorCalibration& sensor,
                                              const OdometryCalibration& fallback) {
  const std::vector<SightingPair> pairs = Thinned(CollectPairs(run, sensor), kMaxPairs);
  if (pairs.size() < kMinPairs) return fallback;
  const std::vector<SightingPair> coarse = Thinned(pairs, kCoarsePairs);
  const DeadReckoning path(run.odometry);
  const auto fit_at = [&](const std::vector<SightingPair>& used, double lag_s) {
    const Duration lag = FromSeconds(lag_s);
    std::vector<Eigen::Vector3d> twists;
    for (const SightingPair& pair : used)
      twists.push_back(path.Twist(pair.begin - lag, pair.end - lag));
    return FitScales(used, twists, fallback);
  };

  constexpr double kLagStep = 0.1;
  constexpr double kMinLag = -0.6;
  std::array<double, 13> cost{};
  for (std::size_t i = 0; i < cost.size(); ++i) {
    cost[i] = fit_at(coarse, kMinLag + kLagStep * static_cast<double>(i)).cost;
  }
  const auto best =
      static_cast<std::size_t>(std::min_element(cost.begin(), cost.end()) - cost.begin());
  double lag_s = kMinLag + kLagStep * static_cast<double>(best);
  if (best > 0 && best + 1 < cost.size()) {
    const double curvature = cost[best - 1] - 2.0 * cost[best] + cost[best + 1];
    if (curvature > 0.0) lag_s += 0.5 * kLagStep * (cost[best - 1] - cost[best + 1]) / curvature;
  }
  const ScaleFit fit = fit_at(pairs, lag_s);
  OdometryCalibration calibration = fallback;
  calibration.scale_v = std::exp(fit.log_scale.x());
  calibration.scale_omega = std::exp(fit.log_scale.y());
  calibration.lag_s = lag_s;
  return calibration;
}

}  // namespace shiftmap
