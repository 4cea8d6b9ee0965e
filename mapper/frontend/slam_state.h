// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "localizer/models/motion_model.h"
#include "localizer/models/observation_model.h"
#include "mapstore/geometry/covariance.h"
#include "mapstore/geometry/se2.h"
#include "mapstore/map/calibration.h"
#include "mapstore/run/run.h"

namespace shiftmap {

/// An observation held against a landmark of a SlamState.
struct SlamPair {
  int landmark = 0;
  const Observation* observation = nullptr;
};

/// What a list of pairs says together: innovations stacked, two rows per pair.
struct JointInnovation {
  Eigen::VectorXd nu;
  Eigen::MatrixXd S;    ///< Their joint covariance H P Hᵀ + R; R only in diagonal blocks.
  Eigen::MatrixXd PHt;  ///< Covariance of the active states with H times them.
  std::vector<Innovation> pairs;  ///< Each by itself.
};

/// The state of EKF-SLAM, in the frame of its first pose or of the landmarks that it knew: the
/// vehicle's pose, the log scales of its odometry, landmark positions, and their joint covariance.
///
/// Compressed filter (Guivant, Nebot, 2001): a step touches the vehicle and the *active* landmarks
/// only, those around the vehicle. What steps do to the others is gathered in Φ, Ψ, θ over the
/// active states and applied when the active set changes. The estimates are those of the full
/// filter, with invariant errors to first order; a step costs the square of the active states, a
/// change of the set that of all.
class SlamState {
 public:
  /// What errors are of when a correction moves the estimate. As EKF-SLAM is printed they stay as
  /// numbers. Then a turn of pose and landmarks together, of which no observation tells, is
  /// another combination of them before and after, and the filter comes to believe that it knows
  /// it. Invariant errors turn with the estimate (A. Barrau, S. Bonnabel: An EKF-SLAM algorithm
  /// with consistency properties, arXiv:1510.06263, 2015).
  enum class Errors { kPrinted, kInvariant };

  explicit SlamState(const Calibration& calibration, Errors errors = Errors::kPrinted);

  /// Adds landmarks that are known before anything was seen, and returns the id of the first; the
  /// others follow. Active. Precondition: nothing is passive.
  /// @param cov  Joint covariance, 2n x 2n. [m²]
  int AddKnown(std::span<const Eigen::Vector2d> positions, const Eigen::MatrixXd& cov);

  /// Forgets where the vehicle was: it, or another one, goes on from a pose that is independent of
  /// the landmarks, with odometry and sensor of their own.
  void StartFrom(const PoseWithCovariance& pose, const Calibration& calibration);

  /// After StartFrom(), whose covariance then is that of the pose among these landmarks: where they
  /// are off together, in least squares by one rigid motion, the pose is off as they are. Nothing
  /// changes where they tell no rigid motion, as one landmark. Precondition: they are active.
  void TieStartTo(const std::vector<int>& landmarks);

  const Se2& pose() const { return pose_; }
  PoseWithCovariance Pose() const { return {pose_, PoseCovariance()}; }

  /// The calibration with the scales as estimated so far.
  OdometryCalibration Odometry() const;

  /// Of the pose, vehicle frame, order (x, y, yaw). [m, m, rad]
  Eigen::Matrix3d PoseCovariance() const { return covariance_.topLeftCorner<3, 3>(); }

  /// Ids of the active landmarks; those within the reach of the last Focus() are among them.
  const std::vector<int>& active() const { return active_; }

  /// Landmarks, active or not.
  std::size_t size() const { return active_.size() + passive_.size(); }

  /// Up to date for active landmarks, or after Settle(). [m]
  const Eigen::Vector2d& Position(int landmark) const { return At(landmark).position; }

  /// Of p_a - p_b, both active. [m²]
  Eigen::Matrix2d DifferenceCovariance(int a, int b) const;

  /// Of a landmark's position, active; zero uncertainty of the first pose. [m²]
  Eigen::Matrix2d PositionCovariance(int landmark) const;

  /// Of (log scale_v, log scale_omega), as estimated so far about that of the calibration.
  const Eigen::Vector2d& log_scale() const { return log_scale_; }

  bool IsActive(int landmark) const { return At(landmark).active >= 0; }

  /// Of active landmarks in this order, 2n x 2n. [m²]
  Eigen::MatrixXd LandmarkCovariance(const std::vector<int>& landmarks) const;

  /// Of the pose, order (x, y, yaw), and all active landmarks. [m², m rad, rad²]
  Eigen::MatrixXd PoseAndLandmarkCovariance() const;

  /// Where a landmark is expected, seen from the vehicle, and the covariance of that by pose and
  /// landmark. Active. [m], [m²]
  struct Relative {
    Eigen::Vector2d q_vehicle = Eigen::Vector2d::Zero();
    Eigen::Matrix2d cov = Eigen::Matrix2d::Zero();
  };
  Relative RelativeTo(int landmark) const;

  void Predict(const MotionIncrement& motion);

  /// Adds the landmark that an observation sees, and returns its id; active.
  int Add(const Observation& observation);

  /// Forgets what is known of a landmark and begins anew with one observation.
  void Place(int landmark, const Observation& observation);

  void Remove(int landmark);

  /// Makes sure that all landmarks within `reach_m` of the vehicle are active.
  void Focus(double reach_m);

  /// Makes one landmark active, wherever it is.
  void Activate(int landmark);

  /// Brings the landmarks that are not active up to date.
  void Settle();

  /// One observation by itself: as Innovate() of one pair, without PHt.
  Innovation Linearized(const SlamPair& pair, Eigen::Matrix2d* S) const;

  /// Precondition, here and in Update(): the landmarks are active.
  JointInnovation Innovate(std::span<const SlamPair> pairs) const;

  /// Corrects the state by all pairs in one step; not at all if their covariance has diverged.
  /// Returns the innovation that it did so by.
  JointInnovation Update(std::span<const SlamPair> pairs);

  /// Takes two active landmarks for one: p_a = p_b. `b` is removed.
  void Fuse(int a, int b);

  /// True if both have the same landmarks under the same ids.
  bool HasLandmarksOf(const SlamState& other) const;

  /// Squared Mahalanobis distance of the two estimates of pose and active landmarks as if they were
  /// independent, T-IV (26). Precondition: HasLandmarksOf(), the same ones active.
  double SquaredDistanceTo(const SlamState& other) const;

  /// The Gaussian with mean and covariance of the mixture of this, (1 - share), and `other`, share.
  /// Precondition: HasLandmarksOf(). All landmarks are active after it.
  void MixWith(SlamState other, double share);

 private:
  struct Landmark {
    Eigen::Vector2d position = Eigen::Vector2d::Zero();
    int active = -1;   // Index in active_, or -1.
    int passive = -1;  // Index in passive_, or -1. Both -1: removed.
  };

  const Landmark& At(int landmark) const { return landmarks_[static_cast<std::size_t>(landmark)]; }
  Landmark& At(int landmark) { return landmarks_[static_cast<std::size_t>(landmark)]; }
  int Offset(int landmark) const;  // First row in covariance_. Precondition: active.

  // The correction by innovation `nu` with covariance S; PHt as in JointInnovation.
  void Correct(const Eigen::VectorXd& nu,
               const Eigen::MatrixXd& S,
               const Eigen::MatrixXd& PHt,
               const Eigen::MatrixXd& HPhi);
  void Initialize(int landmark, const Observation& observation);
  void RemoveActive(int index);
  void SetActive(const std::vector<int>& landmarks);  // Precondition: settled.
  void BeginGathering();
  Eigen::VectorXd StepTo(const SlamState& other) const;  // Of the active states.

  // Takes errors about an estimate to be about the present one.
  void Transport(const Se2& pose_before, const Eigen::VectorXd& step);
  void TransportPassive(const Eigen::VectorXd& step);

  Calibration calibration_;
  Errors errors_;
  Se2 pose_;
  Eigen::Vector2d log_scale_ = Eigen::Vector2d::Zero();
  std::vector<Landmark> landmarks_;
  std::vector<int> active_;
  std::vector<int> passive_;

  Eigen::MatrixXd covariance_;          // Of the active states, now.
  Eigen::MatrixXd cross_;               // Active with passive states, at the last change of set.
  Eigen::MatrixXd passive_covariance_;  // At that time.
  Eigen::MatrixXd phi_;                 // cross_ is now phi_ * cross_.
  Eigen::MatrixXd psi_;                 // passive_covariance_ is now that minus crossᵀ psi cross.
  Eigen::VectorXd theta_;               // Passive positions are now those plus crossᵀ theta.

  Eigen::Vector2d focus_centre_ = Eigen::Vector2d::Zero();
  double focus_radius_ = -1.0;  // All landmarks within it are active; < 0 for none.
};

}  // namespace shiftmap
