// SPDX-License-Identifier: Apache-2.0
#include "localizer/initialization/global_start.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <map>
#include <vector>

#include "localizer/initialization/start_pose.h"
#include "mapstore/geometry/angle.h"

namespace shiftmap {
namespace {

constexpr int kMaxClusters = 40;
constexpr std::size_t kMaxRefined = 40;
constexpr int kRefinements = 3;
constexpr double kSigmas = 3.0;
constexpr double kMaxResidual = 1.0;           // [m]
constexpr double kMinBaseline = 0.8;           // [m]
constexpr double kDifferentPosition = 1.0;     // [m]
constexpr double kDifferentYaw = 0.35;         // [rad]
constexpr double kMinStartVariance = 0.01;     // (0.1 m)²
constexpr double kMinYawVariance = 0.0025;     // (0.05 rad)²
constexpr double kMaxDriftVariance = 0.04;     // (0.2 m)²
constexpr double kMaxYawDriftVariance = 0.01;  // (0.1 rad)²

// A cluster explained by a mode.
struct Match {
  const SightingCluster* cluster = nullptr;
  const Mode* mode = nullptr;
  double variance = 0.0;  // Of the residual, per coordinate. [m²]
  double squared_residual = 0.0;
};

struct Candidate {
  Se2 T_map_odom;
  Odometer reference;  // Where dead reckoning counts as exact.
  std::vector<Match> matches;
  double log_probability = 0.0;  // Of the modes matched; breaks ties.
};

bool Better(const Candidate& a, const Candidate& b) {
  if (a.matches.size() != b.matches.size()) return a.matches.size() > b.matches.size();
  return a.log_probability > b.log_probability;
}

// Where a pair's own error puts a third landmark: grows with the distance from the pair.
struct PairError {
  Eigen::Vector2d p_odom_middle = Eigen::Vector2d::Zero();
  double variance = 0.0;
  double baseline = 1.0;

  double At(const Eigen::Vector2d& p_odom) const {
    const double lever = 2.0 * (p_odom - p_odom_middle).norm() / baseline;
    return 0.5 * variance * (1.0 + lever * lever);
  }
};

// One step of weighted least squares; returns the information matrix of T_map_odom·Exp(η).
Eigen::Matrix3d GaussNewtonStep(Candidate* candidate) {
  Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
  Eigen::Vector3d gradient = Eigen::Vector3d::Zero();
  const Eigen::Matrix2d R_map_odom = candidate->T_map_odom.Rotation();
  for (const Match& match : candidate->matches) {
    const Eigen::Vector2d& p = match.cluster->p_odom;
    Eigen::Matrix<double, 2, 3> dp_deta;
    dp_deta << 1.0, 0.0, -p.y(), 0.0, 1.0, p.x();
    const Eigen::Matrix<double, 2, 3> J = R_map_odom * dp_deta;
    information += J.transpose() * J / match.variance;
    gradient +=
        J.transpose() * (match.mode->p_map_landmark - candidate->T_map_odom * p) / match.variance;
  }
  if (information.determinant() > 0.0) {
    candidate->T_map_odom = candidate->T_map_odom * Se2::Exp(information.inverse() * gradient);
  }
  return information;
}

class Search {
 public:
  Search(const std::vector<SightingCluster>& clusters, const MapSnapshot& snapshot)
      : clusters_(clusters), snapshot_(snapshot) {
    std::map<int, std::size_t> slots;
    for (const SightingCluster& cluster : clusters) {
      slots_.push_back(slots.emplace(cluster.group, slots.size()).first->second);
    }
    groups_seen_ = slots.size();
  }

  std::vector<Candidate> Run() {
    for (std::size_t i = 0; i < clusters_.size(); ++i) {
      for (std::size_t j = i + 1; j < clusters_.size(); ++j) {
        if (clusters_[i].group != clusters_[j].group) TryPair(clusters_[i], clusters_[j]);
      }
    }
    std::stable_sort(found_.begin(), found_.end(), Better);
    if (found_.size() > kMaxRefined) found_.resize(kMaxRefined);
    for (Candidate& candidate : found_) Refine(&candidate);
    std::stable_sort(found_.begin(), found_.end(), Better);
    return std::move(found_);
  }

 private:
  const LandmarkGroup& GroupOf(const SightingCluster& cluster) const {
    return snapshot_.groups()[static_cast<std::size_t>(cluster.group)];
  }

  void TryPair(const SightingCluster& a, const SightingCluster& b) {
    const Eigen::Vector2d ab_odom = b.p_odom - a.p_odom;
    PairError error;
    error.baseline = ab_odom.norm();
    if (error.baseline < kMinBaseline) return;
    error.p_odom_middle = 0.5 * (a.p_odom + b.p_odom);
    const OdometryCalibration& odometry = snapshot_.calibration().odometry;
    const double variance = a.variance + b.variance + DriftVariance(a, b.odometer, odometry);
    for (const Mode& mode_a : GroupOf(a).modes) {
      for (const Mode& mode_b : GroupOf(b).modes) {
        const Eigen::Vector2d ab_map = mode_b.p_map_landmark - mode_a.p_map_landmark;
        error.variance = variance + 0.5 * mode_a.cov_p_map_landmark.trace() +
                         0.5 * mode_b.cov_p_map_landmark.trace();
        const double mismatch = std::abs(ab_map.norm() - error.baseline);
        if (mismatch > std::min(kSigmas * std::sqrt(error.variance), kMaxResidual)) continue;
        Candidate candidate;
        const double yaw =
            std::atan2(ab_map.y(), ab_map.x()) - std::atan2(ab_odom.y(), ab_odom.x());
        const Eigen::Vector2d p_map_middle = 0.5 * (mode_a.p_map_landmark + mode_b.p_map_landmark);
        const Se2 rotation(0.0, 0.0, yaw);
        candidate.T_map_odom = Se2(p_map_middle - rotation * error.p_odom_middle, yaw);
        candidate.reference = a.odometer;
        FindMatches(error, &candidate);
        if (candidate.matches.size() >= 2) found_.push_back(std::move(candidate));
      }
    }
  }

  // Finds what a candidate explains: per signature the best (cluster, mode) inside the gate.
  void FindMatches(const PairError& error, Candidate* candidate) {
    const OdometryCalibration& odometry = snapshot_.calibration().odometry;
    std::vector<Match> best(groups_seen_);
    for (std::size_t i = 0; i < clusters_.size(); ++i) {
      const SightingCluster& cluster = clusters_[i];
      const Eigen::Vector2d p_map = candidate->T_map_odom * cluster.p_odom;
      const double variance = cluster.variance + error.At(cluster.p_odom) +
                              DriftVariance(cluster, candidate->reference, odometry);
      for (const Mode& mode : GroupOf(cluster).modes) {
        Match match{&cluster, &mode, variance + 0.5 * mode.cov_p_map_landmark.trace(), 0.0};
        match.squared_residual = (mode.p_map_landmark - p_map).squaredNorm();
        const double limit =
            std::min(kSigmas * kSigmas * match.variance, kMaxResidual * kMaxResidual);
        Match& incumbent = best[slots_[i]];
        if (match.squared_residual < limit &&
            (!incumbent.mode || match.squared_residual < incumbent.squared_residual)) {
          incumbent = match;
        }
      }
    }
    candidate->matches.clear();
    candidate->log_probability = 0.0;
    for (const Match& match : best) {
      if (!match.mode) continue;
      candidate->matches.push_back(match);
      const LandmarkGroup& group = GroupOf(*match.cluster);
      constexpr double kMinProbability = 1e-6;
      candidate->log_probability += std::log(
          std::max(group.probabilities[group.StateOf(match.mode->number)], kMinProbability));
    }
  }

  void Refine(Candidate* candidate) {
    for (int i = 0; i < kRefinements; ++i) {
      const Eigen::Matrix3d information = GaussNewtonStep(candidate);
      if (information.determinant() <= 0.0) return;
      PairError exact;  // What is left of the pair's error is in the residuals.
      FindMatches(exact, candidate);
      if (candidate->matches.size() < 2) return;
    }
  }

  const std::vector<SightingCluster>& clusters_;
  const MapSnapshot& snapshot_;
  std::vector<std::size_t> slots_;  // Per cluster: its group's number among those seen.
  std::size_t groups_seen_ = 0;
  std::vector<Candidate> found_;
};

bool ClearlyDifferent(const Candidate& a, const Candidate& b) {
  const Eigen::Vector2d& p = a.reference.p_odom_vehicle;
  return (a.T_map_odom * p - b.T_map_odom * p).norm() > kDifferentPosition ||
         std::abs(WrapAngle(a.T_map_odom.yaw() - b.T_map_odom.yaw())) > kDifferentYaw;
}

// How wrong dead reckoning may be between where a candidate's landmarks were seen and a scan.
Drift DriftTo(const Odometer& odometer,
              const Odometer& reference,
              const OdometryCalibration& calibration) {
  Drift drift = DriftBetween(reference, odometer, calibration);
  drift.position += drift.yaw * (reference.p_odom_vehicle - odometer.p_odom_vehicle).squaredNorm();
  return drift;
}

void SetPose(Candidate best,
             std::span<const ReckonedScan> path,
             const OdometryCalibration& odometry,
             GlobalStart* start) {
  const Eigen::Matrix3d information = GaussNewtonStep(&best);
  double chi2 = 0.0;
  for (const Match& match : best.matches) chi2 += match.squared_residual / match.variance;
  const double dof = 2.0 * static_cast<double>(best.matches.size()) - 3.0;
  const auto far = [&](const ReckonedScan& reckoned) {
    const Drift drift = DriftTo(reckoned.odometer, best.reference, odometry);
    const bool before = reckoned.odometer.time_s < best.reference.time_s;
    return before && (drift.position > kMaxDriftVariance || drift.yaw > kMaxYawDriftVariance);
  };
  const auto first = std::find_if_not(path.begin(), path.end() - 1, far);
  start->scan = static_cast<std::size_t>(first - path.begin());

  const Eigen::Matrix3d to_vehicle = first->T_odom_vehicle.InverseAdjoint();
  const Eigen::Matrix3d cov =
      to_vehicle * information.inverse() * to_vehicle.transpose() * std::max(1.0, chi2 / dof);
  const Drift drift = DriftTo(first->odometer, best.reference, odometry);
  const double position = drift.position + kMinStartVariance;
  const Eigen::Vector3d more(position, position, drift.yaw + kMinYawVariance);
  start->pose.T_map_vehicle = best.T_map_odom * first->T_odom_vehicle;
  start->pose.cov_T_map_vehicle = Symmetrized(cov);
  start->pose.cov_T_map_vehicle.diagonal() += more;
}

}  // namespace

std::optional<GlobalStart> FindGlobalStart(std::span<const WindowScan> window,
                                           const MapSnapshot& snapshot,
                                           const GlobalStartOptions& options) {
  const std::vector<SightingCluster> clusters = ClusterSightings(window, snapshot, kMaxClusters);
  if (clusters.size() < static_cast<std::size_t>(options.min_signatures)) return std::nullopt;
  const std::vector<Candidate> candidates = Search(clusters, snapshot).Run();
  if (candidates.empty()) return std::nullopt;

  const Candidate& best = candidates.front();
  GlobalStart start;
  start.explained = static_cast<int>(best.matches.size());
  for (const Candidate& other : candidates) {
    if (!ClearlyDifferent(best, other)) continue;
    start.runner_up = static_cast<int>(other.matches.size());
    break;
  }
  if (start.explained < options.min_signatures ||
      start.explained - start.runner_up < options.min_margin) {
    return std::nullopt;
  }
  SetPose(best, DeadReckon(window), snapshot.calibration().odometry, &start);
  // Sightings far out of any sensor's reach may agree on a pose that is not one.
  if (!ValidateStart(start.pose).ok()) return std::nullopt;
  return start;
}

}  // namespace shiftmap
