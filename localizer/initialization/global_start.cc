// SPDX-License-Identifier: Apache-2.0
#include "localizer/initialization/global_start.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <map>
#include <vector>

#include "localizer/hypothesis/log_math.h"
#include "localizer/initialization/start_pose.h"
#include "localizer/models/site_area.h"
#include "mapstore/geometry/angle.h"

namespace shiftmap {
namespace {

constexpr int kMaxClusters = 40;
constexpr std::size_t kMaxRefined = 40;
constexpr int kRefinements = 3;
constexpr double kSigmas = 3.0;
constexpr double kMaxResidual = 1.0;        // [m]
constexpr double kMinBaseline = 0.8;        // [m]
constexpr double kNoneAgrees = 0.02;        // Probability that no two landmarks stand at modes.
constexpr double kLayoutChange = 0.5;       // Probability that modes' probabilities say nothing.
constexpr double kMinElsewhere = 0.02;      // Probability of a landmark to be at none of its modes.
constexpr double kMinStartVariance = 0.01;  // (0.1 m)²
constexpr double kMinYawVariance = 0.0025;  // (0.05 rad)²
constexpr double kMaxDriftVariance = 0.04;  // (0.2 m)²
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
  double log_probability = 0.0;                           // Of the modes matched; breaks ties.
  Eigen::Matrix3d information = Eigen::Matrix3d::Zero();  // Of T_map_odom·Exp(η).
  double log_weight = 0.0;  // Against no pose that explains two landmarks.
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
      : clusters_(clusters), snapshot_(snapshot), area_(SiteArea(snapshot)) {
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
    std::erase_if(found_, [](const Candidate& candidate) { return candidate.matches.size() < 2; });
    std::stable_sort(found_.begin(), found_.end(), [](const Candidate& a, const Candidate& b) {
      return a.log_weight > b.log_weight;
    });
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
    for (int i = 0; i < kRefinements && candidate->matches.size() >= 2; ++i) {
      candidate->information = GaussNewtonStep(candidate);
      PairError exact;  // What is left of the pair's error is in the residuals.
      FindMatches(exact, candidate);
    }
    const double determinant = candidate->information.determinant();
    if (!(determinant > 0.0)) candidate->matches.clear();
    if (candidate->matches.size() < 2) return;
    // The pose integrated out, against a uniform prior over the map's area.
    candidate->log_weight = LogEvidence(*candidate) + 0.5 * std::log(2.0 * M_PI) -
                            0.5 * std::log(determinant) - std::log(area_);
  }

  // Of all signatures, against each of them seen anywhere.
  double LogEvidence(const Candidate& candidate) const {
    const OdometryCalibration& odometry = snapshot_.calibration().odometry;
    double log_as_known = 0.0;
    double log_all_alike = 0.0;
    std::vector<bool> counted(groups_seen_);
    for (const Match& match : candidate.matches) {
      const SightingCluster& cluster = *match.cluster;
      const LandmarkGroup& group = GroupOf(cluster);
      counted[SlotOf(cluster)] = true;
      const Eigen::Vector2d p_map = candidate.T_map_odom * cluster.p_odom;
      const double variance =
          cluster.variance + DriftVariance(cluster, candidate.reference, odometry);
      double as_known = 0.0;
      double all_alike = 0.0;
      for (std::size_t mode = 0; mode < group.modes.size(); ++mode) {
        const double v = variance + 0.5 * group.modes[mode].cov_p_map_landmark.trace();
        const double squared = (group.modes[mode].p_map_landmark - p_map).squaredNorm();
        const double density = std::exp(-0.5 * squared / v) / (2.0 * M_PI * v);
        as_known += group.probabilities[static_cast<Eigen::Index>(mode) + 1] * density;
        all_alike += density;
      }
      // One of the places that the signature was seen at is explained.
      const double gain = area_ / ClustersOf(cluster.group);
      const auto states = static_cast<double>(group.probabilities.size());
      log_as_known += std::log(Elsewhere(group) + (1.0 - kMinElsewhere) * gain * as_known);
      log_all_alike += std::log((1.0 + gain * all_alike) / states);
    }
    for (const SightingCluster& cluster : clusters_) {
      if (counted[SlotOf(cluster)]) continue;
      counted[SlotOf(cluster)] = true;
      const LandmarkGroup& group = GroupOf(cluster);
      log_as_known += std::log(Elsewhere(group));
      log_all_alike -= std::log(static_cast<double>(group.probabilities.size()));
    }
    return LogAdd(std::log1p(-kLayoutChange) + log_as_known,
                  std::log(kLayoutChange) + log_all_alike);
  }

  static double Elsewhere(const LandmarkGroup& group) {
    return kMinElsewhere + (1.0 - kMinElsewhere) * group.probabilities[0];
  }

  std::size_t SlotOf(const SightingCluster& cluster) const {
    return slots_[static_cast<std::size_t>(&cluster - clusters_.data())];
  }

  double ClustersOf(int group) const {
    return static_cast<double>(
        std::count_if(clusters_.begin(), clusters_.end(), [&](const SightingCluster& cluster) {
          return cluster.group == group;
        }));
  }

  const std::vector<SightingCluster>& clusters_;
  const MapSnapshot& snapshot_;
  double area_;                     // [m²]
  std::vector<std::size_t> slots_;  // Per cluster: its group's number among those seen.
  std::size_t groups_seen_ = 0;
  std::vector<Candidate> found_;
};

// The covariance of T_map_odom · T_odom_vehicle.
Eigen::Matrix3d CovAt(const Se2& T_odom_vehicle, const Eigen::Matrix3d& information) {
  const Eigen::Matrix3d to_vehicle = T_odom_vehicle.InverseAdjoint();
  return to_vehicle * information.inverse() * to_vehicle.transpose();
}

// The pose of a candidate where a vehicle is in the dead-reckoned frame, as a start states it but
// for the drift until there.
PoseWithCovariance PoseAt(const Se2& T_odom_vehicle, const Candidate& candidate) {
  PoseWithCovariance pose;
  pose.T_map_vehicle = candidate.T_map_odom * T_odom_vehicle;
  pose.cov_T_map_vehicle = Symmetrized(CovAt(T_odom_vehicle, candidate.information));
  pose.cov_T_map_vehicle.diagonal() +=
      Eigen::Vector3d(kMinStartVariance, kMinStartVariance, kMinYawVariance);
  return pose;
}

// Whether a start at one pose would take the other for wrong.
bool ClearlyDifferent(const Candidate& a, const Candidate& b) {
  const Se2 T_odom_vehicle(a.reference.p_odom_vehicle, 0.0);
  return ClearlyApart(PoseAt(T_odom_vehicle, a), PoseAt(T_odom_vehicle, b));
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

  const Eigen::Matrix3d cov = CovAt(first->T_odom_vehicle, information) * std::max(1.0, chi2 / dof);
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
  // Of other poses each counts once, by the best of those that are the same.
  std::vector<const Candidate*> others;
  double odds_against = kNoneAgrees / (1.0 - kNoneAgrees) * std::exp(-best.log_weight);
  for (const Candidate& other : candidates) {
    const bool is_new = ClearlyDifferent(best, other) &&
                        std::all_of(others.begin(), others.end(), [&](const Candidate* known) {
                          return ClearlyDifferent(*known, other);
                        });
    if (!is_new) continue;
    others.push_back(&other);
    odds_against += std::exp(other.log_weight - best.log_weight);
  }
  GlobalStart start;
  start.explained = static_cast<int>(best.matches.size());
  start.probability = 1.0 / (1.0 + odds_against);
  if (start.explained < options.min_signatures || start.probability < options.min_probability) {
    return std::nullopt;
  }
  SetPose(best, DeadReckon(window), snapshot.calibration().odometry, &start);
  // Sightings far out of any sensor's reach may agree on a pose that is not one.
  if (!ValidateStart(start.pose).ok()) return std::nullopt;
  return start;
}

}  // namespace shiftmap
