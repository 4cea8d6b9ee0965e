// SPDX-License-Identifier: Apache-2.0
#include "localizer/initialization/global_start.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <vector>

#include "localizer/hypothesis/log_math.h"
#include "localizer/initialization/start_pose.h"
#include "localizer/models/site_area.h"
#include "mapstore/geometry/angle.h"

namespace shiftmap {
namespace {

constexpr int kMaxClusters = 40;            // Time grows with the square.
constexpr std::size_t kMaxRefined = 40;     // Poses, the best of them.
constexpr int kRefinements = 3;             // Of a pose and its matches, in turn.
constexpr double kSigmas = 3.0;             // Up to which a cluster matches a mode.
constexpr double kMaxResidual = 1.0;        // [m]
constexpr double kMinBaseline = 0.8;        // [m]
constexpr double kNoneAgrees = 0.02;        // Probability that no two landmarks stand at modes.
constexpr double kSlip = 1e-3;              // Probability that dead reckoning slips in a window.
constexpr double kMaxOddsOfNear = 0.01;     // Of poses that the covariance of a start excludes.
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

// Most pairs of one pose's landmarks find it, each a little differently.
bool ExplainTheSame(const Candidate& a, const Candidate& b) {
  return std::equal(
      a.matches.begin(),
      a.matches.end(),
      b.matches.begin(),
      b.matches.end(),
      [](const Match& x, const Match& y) { return x.cluster == y.cluster && x.mode == y.mode; });
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
  // @param stamp  At which the modes hold.
  Search(const std::vector<SightingCluster>& clusters, const MapSnapshot& snapshot, Stamp stamp)
      : clusters_(clusters), snapshot_(snapshot), area_(SiteArea(snapshot)) {
    std::map<int, std::size_t> slots;
    for (const SightingCluster& cluster : clusters) {
      const auto [slot, is_new] = slots.emplace(cluster.group, slots.size());
      slots_.push_back(slot->second);
      if (!is_new) continue;
      const LandmarkGroup& group = GroupOf(cluster);
      probabilities_.push_back(group.chain.Propagate(group.probabilities, snapshot.stamp(), stamp));
    }
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
    std::vector<Candidate> poses;
    for (Candidate& candidate : found_) {
      const bool known = std::any_of(poses.begin(), poses.end(), [&](const Candidate& pose) {
        return ExplainTheSame(pose, candidate);
      });
      if (!known) poses.push_back(std::move(candidate));
    }
    return poses;
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
    std::vector<Match> best(probabilities_.size());
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
      constexpr double kMinProbability = 1e-6;  // Of a mode that the map rules out.
      const double probability = ProbabilitiesOf(*match.cluster)[group.StateOf(match.mode->number)];
      candidate->log_probability += std::log(std::max(probability, kMinProbability));
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
    std::vector<bool> counted(probabilities_.size());
    for (const Match& match : candidate.matches) {
      const SightingCluster& cluster = *match.cluster;
      const LandmarkGroup& group = GroupOf(cluster);
      const Eigen::VectorXd& probabilities = ProbabilitiesOf(cluster);
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
        as_known += probabilities[static_cast<Eigen::Index>(mode) + 1] * density;
        all_alike += density;
      }
      // One of the places that the signature was seen at is explained.
      const double gain = area_ / ClustersOf(cluster.group);
      const auto states = static_cast<double>(probabilities.size());
      log_as_known += std::log(Elsewhere(probabilities) + (1.0 - kMinElsewhere) * gain * as_known);
      log_all_alike += std::log((1.0 + gain * all_alike) / states);
    }
    for (const SightingCluster& cluster : clusters_) {
      if (counted[SlotOf(cluster)]) continue;
      counted[SlotOf(cluster)] = true;
      const Eigen::VectorXd& probabilities = ProbabilitiesOf(cluster);
      log_as_known += std::log(Elsewhere(probabilities));
      log_all_alike -= std::log(static_cast<double>(probabilities.size()));
    }
    return LogAdd(std::log1p(-kLayoutChange) + log_as_known,
                  std::log(kLayoutChange) + log_all_alike);
  }

  static double Elsewhere(const Eigen::VectorXd& probabilities) {
    return kMinElsewhere + (1.0 - kMinElsewhere) * probabilities[0];
  }

  const Eigen::VectorXd& ProbabilitiesOf(const SightingCluster& cluster) const {
    return probabilities_[SlotOf(cluster)];
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
  double area_;                                 // [m²]
  std::vector<std::size_t> slots_;              // Per cluster: its group's number among those seen.
  std::vector<Eigen::VectorXd> probabilities_;  // Per group seen: of its states.
  std::vector<Candidate> found_;
};

// The pose of a candidate where a vehicle is in the dead-reckoned frame, as a start states it.
// @param cov_T_map_odom  Of T_map_odom·Exp(η).
// @param drift           Until there.
PoseWithCovariance PoseAt(const Se2& T_odom_vehicle,
                          const Se2& T_map_odom,
                          const Eigen::Matrix3d& cov_T_map_odom,
                          const Drift& drift) {
  const Eigen::Matrix3d to_vehicle = T_odom_vehicle.InverseAdjoint();
  const double position = drift.position + kMinStartVariance;
  PoseWithCovariance pose;
  pose.T_map_vehicle = T_map_odom * T_odom_vehicle;
  pose.cov_T_map_vehicle = Symmetrized(to_vehicle * cov_T_map_odom * to_vehicle.transpose());
  pose.cov_T_map_vehicle.diagonal() +=
      Eigen::Vector3d(position, position, drift.yaw + kMinYawVariance);
  return pose;
}

// Whether a start at one pose would take the other for wrong.
bool ClearlyDifferent(const Candidate& a, const Candidate& b) {
  const Se2 T_odom_vehicle(a.reference.p_odom_vehicle, 0.0);
  return ClearlyApart(PoseAt(T_odom_vehicle, a.T_map_odom, a.information.inverse(), {}),
                      PoseAt(T_odom_vehicle, b.T_map_odom, b.information.inverse(), {}));
}

// How wrong dead reckoning may be between where a candidate's landmarks were seen and a scan.
Drift DriftTo(const Odometer& odometer,
              const Odometer& reference,
              const OdometryCalibration& calibration) {
  Drift drift = DriftBetween(reference, odometer, calibration);
  drift.position += drift.yaw * (reference.p_odom_vehicle - odometer.p_odom_vehicle).squaredNorm();
  return drift;
}

// The scan of a start: as far back as dead reckoning is still good for.
std::size_t FirstScan(const Candidate& best,
                      std::span<const ReckonedScan> path,
                      const OdometryCalibration& odometry) {
  const auto far = [&](const ReckonedScan& reckoned) {
    const Drift drift = DriftTo(reckoned.odometer, best.reference, odometry);
    const bool before = reckoned.odometer.time_s < best.reference.time_s;
    return before && (drift.position > kMaxDriftVariance || drift.yaw > kMaxYawDriftVariance);
  };
  const auto first = std::find_if_not(path.begin(), path.end() - 1, far);
  return static_cast<std::size_t>(first - path.begin());
}

// What a candidate says of the pose at a scan.
PoseWithCovariance PoseAtScan(Candidate candidate,
                              const ReckonedScan& scan,
                              const OdometryCalibration& odometry) {
  const Eigen::Matrix3d information = GaussNewtonStep(&candidate);
  double chi2 = 0.0;
  for (const Match& match : candidate.matches) chi2 += match.squared_residual / match.variance;
  const double dof = 2.0 * static_cast<double>(candidate.matches.size()) - 3.0;
  return PoseAt(scan.T_odom_vehicle,
                candidate.T_map_odom,
                information.inverse() * std::max(1.0, chi2 / dof),
                DriftTo(scan.odometer, candidate.reference, odometry));
}

// Mean and covariance of a mixture of poses that are near each other.
// @param weights  Positive.
PoseWithCovariance MomentsOf(const std::vector<PoseWithCovariance>& poses,
                             const std::vector<double>& weights) {
  const Se2 T_vehicle_map = poses.front().T_map_vehicle.Inverse();
  const double total = std::accumulate(weights.begin(), weights.end(), 0.0);
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  Eigen::Matrix3d square = Eigen::Matrix3d::Zero();
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const Eigen::Vector3d offset = (T_vehicle_map * poses[i].T_map_vehicle).Log();
    const double share = weights[i] / total;
    mean += share * offset;
    square += share * (poses[i].cov_T_map_vehicle + offset * offset.transpose());
  }
  return {poses.front().T_map_vehicle * Se2::Exp(mean),
          Symmetrized(square - mean * mean.transpose())};
}

// A pose at the end of a window, and log of its weight with the prior.
struct WeighedPose {
  PoseWithCovariance pose;
  double log_weight = 0.0;
};

// As FindGlobalStart.
// @param log_prior  Of the window: that dead reckoning did not slip in it, but before.
// @param poses      Poses of longer windows. A window that does not decide adds its own.
std::optional<GlobalStart> StartIn(std::span<const WindowScan> window,
                                   const MapSnapshot& snapshot,
                                   const GlobalStartOptions& options,
                                   double log_prior,
                                   std::vector<WeighedPose>* poses) {
  const std::vector<SightingCluster> clusters = ClusterSightings(window, snapshot, kMaxClusters);
  if (clusters.size() < static_cast<std::size_t>(options.min_signatures)) return std::nullopt;
  const std::vector<Candidate> candidates =
      Search(clusters, snapshot, window.back().scan.stamp).Run();
  if (candidates.empty()) return std::nullopt;
  const std::vector<ReckonedScan> path = DeadReckon(window);
  const OdometryCalibration& odometry = snapshot.calibration().odometry;

  const Candidate& best = candidates.front();
  const double log_best = best.log_weight + log_prior;
  double odds_against = kNoneAgrees / (1.0 - kNoneAgrees) * std::exp(-log_best);
  const PoseWithCovariance at_end = PoseAtScan(best, path.back(), odometry);
  for (const WeighedPose& other : *poses) {
    if (ClearlyApart(at_end, other.pose)) odds_against += std::exp(other.log_weight - log_best);
  }
  // Of other poses each counts once, by the best of those that are the same.
  std::vector<const Candidate*> others;
  std::vector<const Candidate*> near;
  double odds_of_near = 0.0;  // Of those that the covariance of the best one excludes.
  for (const Candidate& other : candidates) {
    if (!ClearlyDifferent(best, other)) {
      near.push_back(&other);
      PoseWithCovariance exact = PoseAtScan(other, path.back(), odometry);
      exact.cov_T_map_vehicle.setZero();
      if (ClearlyApart(at_end, exact)) {
        odds_of_near += std::exp(other.log_weight - best.log_weight);
      }
      continue;
    }
    const bool known = std::any_of(others.begin(), others.end(), [&](const Candidate* candidate) {
      return !ClearlyDifferent(*candidate, other);
    });
    if (known) continue;
    others.push_back(&other);
    odds_against += std::exp(other.log_weight - best.log_weight);
  }
  GlobalStart start;
  start.explained = static_cast<int>(best.matches.size());
  start.probability = 1.0 / (1.0 + odds_against);
  if (start.explained < options.min_signatures || start.probability < options.min_probability ||
      odds_of_near > kMaxOddsOfNear) {
    poses->push_back({at_end, log_best});
    for (const Candidate* other : others) {
      poses->push_back({PoseAtScan(*other, path.back(), odometry), other->log_weight + log_prior});
    }
    return std::nullopt;
  }
  start.scan = FirstScan(best, path, odometry);
  std::vector<PoseWithCovariance> of_start;
  std::vector<double> weights;
  for (const Candidate* candidate : near) {
    of_start.push_back(PoseAtScan(*candidate, path[start.scan], odometry));
    weights.push_back(std::exp(candidate->log_weight - best.log_weight));
  }
  start.pose = MomentsOf(of_start, weights);
  // Sightings far out of any sensor's reach may agree on a pose that is not one.
  if (!ValidateStart(start.pose).ok()) return std::nullopt;
  return start;
}

}  // namespace

std::optional<GlobalStart> FindGlobalStart(std::span<const WindowScan> window,
                                           const MapSnapshot& snapshot,
                                           const GlobalStartOptions& options) {
  std::vector<WeighedPose> poses;
  return StartIn(window, snapshot, options, 0.0, &poses);
}

PoseWithCovariance PoseAtEnd(const GlobalStart& start, std::span<const WindowScan> window) {
  PoseWithCovariance pose = start.pose;
  for (const WindowScan& scan : window.subspan(start.scan + 1)) {
    pose = Moved(pose, scan.motion.increment);
  }
  return pose;
}

std::optional<GlobalStart> FindRecentStart(std::span<const WindowScan> window,
                                           const MapSnapshot& snapshot,
                                           const GlobalStartOptions& options) {
  std::vector<WeighedPose> poses;
  double log_prior = 0.0;
  for (std::size_t length = window.size(); length > 0; length /= 2) {
    const std::size_t first = window.size() - length;
    auto start = StartIn(window.subspan(first), snapshot, options, log_prior, &poses);
    if (start) {
      start->scan += first;
      return start;
    }
    log_prior = std::log(kSlip);
  }
  return std::nullopt;
}

}  // namespace shiftmap
