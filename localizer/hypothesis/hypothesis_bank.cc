// SPDX-License-Identifier: Apache-2.0
//
// Which groups are in view, and what a step is. How observations and misses count:
// hypothesis_scoring.cc.
#include "localizer/hypothesis/hypothesis_bank.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "localizer/initialization/start_pose.h"
#include "localizer/models/site_area.h"
#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

// What odometry is trusted with where nothing that is seen agrees.
constexpr double kTrustedDistance = 0.3;  // [m]
constexpr double kTrustedTurn = 0.1;      // [rad]

// Ways without sightings on which wheels slip, as a share; and ways of this length beside a single
// landmark. [-], [m]
constexpr double kSlipShare = 0.1;
constexpr double kLaterSlipShare = 0.01;
constexpr double kLaterSlip = 2.0;

// Another pose is considered if it is less likely so far. [-]
constexpr double kConsidered = 1e-3;

// A leaf with a pose vaguer than this does not stand for another pose within it. [m]
constexpr double kVague = 1.0;

// Landmarks farther off, in ranges of the sensor, are not around. [-]
constexpr double kAround = 8.0;

// A landmark's probabilities that differ by more were learned since the map was made. [-]
constexpr double kLearned = 0.1;

Eigen::Vector2d EdgeOfView(const SensorCalibration& sensor) {
  const double bearing = std::min(sensor.max_bearing_rad, std::numbers::pi);
  return {std::cos(bearing), std::sin(bearing)};
}

// Children that an observation may fork a leaf into.
std::size_t MostForks(const MapSnapshot& snapshot) {
  std::size_t forks = 1;
  for (const LandmarkGroup& group : snapshot.groups()) {
    forks = std::max(forks, group.modes.size() + 1);
  }
  return forks;
}

}  // namespace

HypothesisBank::HypothesisBank(MapSnapshot snapshot,
                               const HypothesisOptions& options,
                               const PoseWithCovariance& start,
                               Stamp stamp)
    : snapshot_(std::move(snapshot)),
      options_(options),
      view_(snapshot_.calibration().sensor, options.field_of_view.own),
      grid_(snapshot_, snapshot_.calibration().sensor.max_range_m),
      gate_(ChiSquareQuantile(options.gate_probability, 2)),
      unknown_place_density_(UnknownPlaceDensity(snapshot_)),
      edge_of_view_(EdgeOfView(snapshot_.calibration().sensor)),
      tree_({options.alpha, options.max_leaves, options.visit_gap_s},
            snapshot_.groups(),
            snapshot_.stamp()) {
  Restart(start, stamp);
  const std::size_t forks = MostForks(snapshot_);
  tree_.Reserve(forks);
  judged_.reserve(forks);
}

void BankEvents::Clear() {
  outcomes.clear();
  evidence.clear();
  decisions.clear();
}

void HypothesisBank::Restart(const PoseWithCovariance& start, Stamp stamp, Stamp wrong_since) {
  tree_.ForgetSince(wrong_since, snapshot_.groups(), snapshot_.stamp());
  stamp_ = stamp;
  agreed_ = {};
  ConfirmPose();
  tree_.Restart({KnownMapFilter(start, snapshot_.calibration())});
}

bool HypothesisBank::Consider(const PoseWithCovariance& pose) {
  LeafSet<Leaf>& leaves = tree_.leaves();
  const double log_considered = std::log(kConsidered);
  if (std::any_of(leaves.all().begin(), leaves.all().end(), [&](const Leaf* leaf) {
        const PoseWithCovariance held = leaf->filter.Pose();
        const bool vague = held.cov_T_map_vehicle.topLeftCorner<2, 2>().trace() > kVague * kVague;
        return leaf->log_weight > log_considered && !vague && !Apart(held, pose);
      })) {
    return false;
  }
  // By another pose nothing holds that was concluded by this one: there, all is as in the map.
  const auto prior = [&](int group) {
    const LandmarkGroup& landmark = GroupAt(group);
    return landmark.chain.Propagate(landmark.probabilities, snapshot_.stamp(), stamp_);
  };
  for (int group = 0; group < static_cast<int>(snapshot_.groups().size()); ++group) {
    const Eigen::VectorXd learned = Probabilities(group) - prior(group);
    if (learned.cwiseAbs().maxCoeff() > kLearned) tree_.Hold(group, snapshot_.groups(), stamp_);
  }
  Leaf other = best();
  other.filter = KnownMapFilter(pose, snapshot_.calibration());
  for (PlaceBelief& belief : other.beliefs) {
    belief = HypothesisTree<Leaf>::BeliefOf(belief.group, prior(belief.group));
    // What the visit gave up it did by the other leaves' poses.
    Visit* const visit = tree_.FindVisit(belief.group);
    if (visit) std::fill(visit->given_up.begin(), visit->given_up.end(), std::nullopt);
  }
  other.log_weight = 0.0;  // As heavy as all others together.
  leaves.Add(other);
  tree_.Reduce();
  return true;
}

PoseWithCovariance HypothesisBank::Pose() const {
  PoseWithCovariance pose = best().filter.Pose();
  if (tree_.leaves().size() == 1) return pose;
  const Se2 T_best_map = pose.T_map_vehicle.Inverse();
  pose.cov_T_map_vehicle.setZero();
  for (const Leaf* leaf : tree_.leaves().all()) {
    const PoseWithCovariance other = leaf->filter.Pose();
    const Eigen::Vector3d xi = (T_best_map * other.T_map_vehicle).Log();
    const Eigen::Matrix3d J = Se2::RightJacobian(xi).inverse();
    pose.cov_T_map_vehicle += std::exp(leaf->log_weight) *
                              (J * other.cov_T_map_vehicle * J.transpose() + xi * xi.transpose());
  }
  return pose;
}

double HypothesisBank::SdAmongLandmarks() const {
  const PoseWithCovariance pose = best().filter.Pose();
  double sd = LargestSd(pose.cov_T_map_vehicle.topLeftCorner<2, 2>());
  const double max_range = snapshot_.calibration().sensor.max_range_m;
  bool found = false;
  for (double radius = max_range; !found && radius <= kAround * max_range; radius *= 2.0) {
    grid_.VisitNear(pose.T_map_vehicle.translation(), radius, [&](const ModeGrid::Entry& entry) {
      const auto point = best().filter.PredictPoint({entry.group, entry.mode + 1}, snapshot_);
      sd = std::min(sd, LargestSd(point.cov_q));
      found = true;
    });
  }
  return sd;
}

double HypothesisBank::ShareNearer(const Eigen::Vector2d& there,
                                   const Eigen::Vector2d& here) const {
  double share = 0.0;
  for (const Leaf* leaf : tree_.leaves().all()) {
    const Eigen::Vector2d& p = leaf->filter.T_map_vehicle().translation();
    if ((p - there).norm() < (p - here).norm()) share += std::exp(leaf->log_weight);
  }
  return share;
}

void HypothesisBank::Predict(const MotionIncrement& increment, double elapsed_s) {
  T_odom_vehicle_ = T_odom_vehicle_ * increment.T_begin_end;
  unseen_way_.Add(increment);
  for (Leaf* leaf : tree_.leaves().all()) leaf->filter.Predict(increment, elapsed_s);
}

const BankEvents& HypothesisBank::Correct(const Scan& scan, const LidarView* lidar) {
  events_.Clear();
  stamp_ = scan.stamp;
  view_.Look(lidar);
  tree_.CloseStaleVisits(stamp_, [&](std::size_t visit) {
    events_.evidence.push_back(tree_.CloseVisit(visit, snapshot_.groups()));
  });
  OpenVisitsInView(scan);
  for (std::size_t i = 0; i < scan.observations.size(); ++i) {
    const int group = snapshot_.GroupIndex(scan.observations[i].signature);
    if (group >= 0) Take(scan.observations[i], i, group);
  }
  for (const Visit& visit : tree_.visits()) {
    if (!visit.seen) Miss(visit.group);
  }
  tree_.Reduce();
  for (Visit& visit : tree_.visits()) visit.confirmed = IsConfirmed(visit);
  tree_.Test(snapshot_.groups(), stamp_, &events_.decisions);
  tree_.ReleaseAgreedBeliefs();
  return events_;
}

// Wheels slip where nothing is seen: a pose that has moved on is confirmed by two landmarks.
void HypothesisBank::JudgePose(const ObservationOutcome& outcome, Visit* visit) {
  const bool far = IsFarFromConfirmed();
  if (far && !unconfirmed_since_) unconfirmed_since_ = stamp_;
  if (far && !visit->doubted_since && outcome.state != visit->Favourite()) {
    visit->doubted_since = stamp_;
  }
  if (!outcome.gated) return;
  const auto same = [&](const Agreement& other) { return other.group == outcome.group; };
  const auto known = std::find_if(agreed_.begin(), agreed_.end() - 1, same);
  std::move_backward(agreed_.begin(), known, known + 1);
  agreed_.front() = {outcome.group, stamp_};
  if (far && CountAgreeing(*unconfirmed_since_, -1) < kConfirming) return;
  ConfirmPose();
}

void HypothesisBank::ConfirmPose() {
  T_odom_confirmed_ = T_odom_vehicle_;
  unseen_way_.Clear();
  slip_allowed_.reset();
  unconfirmed_since_.reset();
}

bool HypothesisBank::IsFarFromConfirmed() const {
  const Se2 moved = T_odom_confirmed_.Inverse() * T_odom_vehicle_;
  return moved.translation().norm() > kTrustedDistance || std::abs(moved.yaw()) > kTrustedTurn;
}

bool HypothesisBank::HasAgreedSince(int group, Stamp since) const {
  return std::any_of(agreed_.begin(), agreed_.end(), [&](const Agreement& agreement) {
    return agreement.group == group && agreement.stamp > since;
  });
}

void HypothesisBank::AllowForSlip(int group) {
  const double least_m = slip_allowed_ ? kLaterSlip : 0.0;
  if (!(unseen_way_.length_m() > least_m) || !IsFarFromConfirmed()) return;
  if (slip_allowed_ && !HasAgreedSince(group, *slip_allowed_)) return;
  const double share = slip_allowed_ ? kLaterSlipShare : kSlipShare;
  MotionIncrement slip;
  slip.cov.topLeftCorner<2, 2>() = unseen_way_.SlipCovariance();
  slip_allowed_ = stamp_;
  unseen_way_.Clear();
  for (Leaf* leaf : tree_.leaves().Rebuild()) {
    Leaf& slipped = tree_.leaves().Add(*leaf);
    slipped.filter.Predict(slip, 0.0);
    slipped.log_weight += std::log(share);
    leaf->log_weight += std::log1p(-share);
    tree_.leaves().Keep(leaf);
  }
  tree_.leaves().SortByWeight();
}

int HypothesisBank::CountAgreeing(Stamp since, int except) const {
  return static_cast<int>(
      std::count_if(agreed_.begin(), agreed_.end(), [&](const Agreement& agreement) {
        return agreement.group >= 0 && agreement.group != except && agreement.stamp >= since;
      }));
}

bool HypothesisBank::IsConfirmed(const Visit& visit) const {
  return !visit.doubted_since || CountAgreeing(*visit.doubted_since, visit.group) >= kConfirming;
}

std::vector<VisitEvidence> HypothesisBank::EndVisits() {
  std::vector<VisitEvidence> evidence;
  while (!tree_.visits().empty()) evidence.push_back(tree_.CloseVisit(0, snapshot_.groups()));
  return evidence;
}

// Outside of the sector is out of view by either model. By a bound on the bearing's variance that
// needs no correlations: Var(a + b) <= 2 Var a + 2 Var b; and by the distance from the line along
// the edge of the sector, which is no more than range times angle. Spares most groups near the
// vehicle the exact probability.
bool HypothesisBank::FarOutsideSector(const Mode& mode) const {
  constexpr double kSigmas = 6.0;  // P_FOV < 1e-8, below any threshold.
  const KnownMapFilter& filter = best().filter;
  const Eigen::Vector2d q =
      filter.R_vehicle_map() * (mode.p_map_landmark - filter.T_map_vehicle().translation());
  const double outside_m = std::abs(q.y()) * edge_of_view_.x() - q.x() * edge_of_view_.y();
  if (outside_m <= 0.0) return false;
  const double of_pose = filter.covariance().topLeftCorner<2, 2>().trace() +
                         q.squaredNorm() * filter.covariance()(2, 2);
  const double variance = 4.0 * of_pose + 2.0 * mode.cov_p_map_landmark.trace();
  return outside_m * outside_m > kSigmas * kSigmas * variance;
}

bool HypothesisBank::InView(int group, double threshold) const {
  const int modes = static_cast<int>(GroupAt(group).modes.size());
  for (int state = 1; state <= modes; ++state) {
    if (FarOutsideSector(GroupAt(group).modes[static_cast<std::size_t>(state) - 1])) continue;
    const KnownMapFilter::Point point = best().filter.PredictPoint({group, state}, snapshot_);
    if (InView(point).own > threshold) return true;
  }
  return false;
}

void HypothesisBank::OpenVisitsInView(const Scan& scan) {
  for (Visit& visit : tree_.visits()) {
    visit.seen = false;
    if (InView(visit.group, options_.fov_leave)) visit.end = stamp_;
  }
  const PoseWithCovariance pose = best().filter.Pose();
  const double max_range = snapshot_.calibration().sensor.max_range_m;
  const double sd = std::sqrt(pose.cov_T_map_vehicle.topLeftCorner<2, 2>().trace());
  grid_.GroupsNear(
      pose.T_map_vehicle.translation(), max_range + std::min(3.0 * sd, max_range), &nearby_);
  for (const int group : nearby_) {
    if (!tree_.FindVisit(group) && InView(group, options_.fov_enter))
      tree_.OpenVisit(group, snapshot_.groups(), stamp_);
  }
  for (const Observation& observation : scan.observations) {
    const int group = snapshot_.GroupIndex(observation.signature);
    if (group >= 0 && !tree_.FindVisit(group)) tree_.OpenVisit(group, snapshot_.groups(), stamp_);
  }
}

}  // namespace shiftmap
