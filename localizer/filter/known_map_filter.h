// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <boost/container/static_vector.hpp>
#include <limits>

#include "localizer/filter/shared_errors.h"
#include "localizer/filter/unknown_places.h"
#include "localizer/models/motion_model.h"
#include "localizer/models/observation_model.h"
#include "mapstore/geometry/covariance.h"
#include "mapstore/map/calibration.h"
#include "mapstore/map/map_snapshot.h"

namespace shiftmap {

/// Names a mode of a snapshot: index into groups(), and state 1..n as in LandmarkGroup.
struct ModeRef {
  int group = 0;
  int state = 1;
};

/// Extended Kalman filter for the pose of a vehicle on a map that is uncertain and not updated. It
/// estimates landmarks known to have moved (UpdatePlace()).
///
/// State: T_map_vehicle with the perturbation T·Exp(ξ), the deviation of this vehicle's
/// (log scale_v, log scale_omega) from the fleet's calibration, and the log-scale of the positions
/// that it observes: measured over true. Two things are *considered*
/// (Schmidt-Kalman), uncertain but not estimated: the errors of the modes, with the map's joint
/// covariance, and a constant bias of the sensor. A filter that took the map as exact would count
/// the error of a mode anew with each observation of it, and one without a bias would average away
/// what a camera that is mounted askew gets wrong. Equations: localizer/METHOD.md.
///
/// Numbers: a state that is not finite, has a covariance that is not positive definite, or is
/// vaguer than kMaxPositionSd and kMaxYawSd is given up, and the filter starts anew, knowing
/// nothing but the range of kUnknownPositionSd: see IsNowhere(). So a pose is always finite.
///
/// Ownership: keeps no reference to the snapshot; every call must pass the same one.
/// Threads: const-safe. Without heap allocations; a copy takes 6 kB, and up to 11 kB more for modes
/// and places in use.
class KnownMapFilter {
 public:
  /// x, y, yaw, log scale_v, log scale_omega, log range scale.
  static constexpr int kStates = SharedErrors::kStates;
  static constexpr int kRangeScale = SharedErrors::kRangeScale;
  using StateMatrix = SharedErrors::StateMatrix;
  using StateVector = SharedErrors::StateVector;
  using StateByPoint = SharedErrors::StateByPoint;

  /// Modes kept as considered at most; beyond it the one that matters least is let go.
  static constexpr int kMaxConsideredModes = 64;

  /// Standard deviation of the sensor's bias over that of its noise.
  static constexpr double kBiasShare = 0.7;

  /// Standard deviation of the log range scale, at the start and in the long run: sensors of one
  /// kind differ by it. The sensor noise of a map contains the same spread (DECISIONS.md). [-]
  static constexpr double kSdLogRangeScale = 0.02;

  /// Beyond these variances lose the digits that tell landmarks apart. [m], [rad]
  static constexpr double kMaxPositionSd = 1e4;
  static constexpr double kMaxYawSd = 100.0;

  /// Of a pose that nobody knows. [m]
  static constexpr double kUnknownPositionSd = 1e3;

  /// @param start  Independent of the map's errors.
  KnownMapFilter(const PoseWithCovariance& start, const Calibration& calibration);

  /// Moves on by an increment that was integrated with the fleet's calibration; corrects it, to
  /// first order, for what this vehicle's own was found to be.
  /// @param elapsed_s  Duration of the increment, for the random walk of the calibration. [s]
  void Predict(const MotionIncrement& increment, double elapsed_s);

  /// Where a mode is expected: q = T_map_vehicle⁻¹ p_map_landmark, in the vehicle frame. [m]
  struct Point {
    Eigen::Vector2d q = Eigen::Vector2d::Zero();
    Eigen::Matrix<double, 2, 3> H_pose = Eigen::Matrix<double, 2, 3>::Zero();  ///< dq/dξ.
    Eigen::Vector2d H_range_scale = Eigen::Vector2d::Zero();  ///< Of the position observed. [m]
    Eigen::Matrix2d H_landmark = Eigen::Matrix2d::Zero();     ///< dq/dp_map_landmark.
    Eigen::Vector2d q_linear = Eigen::Vector2d::Zero();       ///< Linear model of q at ξ = 0. [m]
    bool relinearized = false;  ///< At the pose that an observation makes likeliest, not at ξ = 0.
    StateByPoint cov_state_q = StateByPoint::Zero();  ///< Of the state's error with q's.
    Eigen::Matrix2d cov_q = Eigen::Matrix2d::Zero();  ///< Of pose, range scale and mode.
  };
  Point PredictPoint(ModeRef mode, const MapSnapshot& snapshot) const;

  /// An observation as the position that it measures, with the noise turned and scaled by it; that
  /// of a Prediction, by where the mode is expected.
  struct Measurement {
    Eigen::Vector2d q = Eigen::Vector2d::Zero();          ///< In the vehicle frame. [m]
    Eigen::Matrix2d cov_z = Eigen::Matrix2d::Zero();      ///< In z's own units.
    Eigen::Matrix2d dq_dz = Eigen::Matrix2d::Zero();      ///< From z's own units to positions.
    Eigen::Matrix2d cov_noise = Eigen::Matrix2d::Zero();  ///< Of q, the sensor's alone. [m²]
    double log_m2_per_unit = 0.0;                         ///< log |dq/dz|.
    Observation::Kind kind = Observation::Kind::kRangeBearing;
  };
  /// @param cov_z  Of the observation, in its own units.
  static Measurement Measure(const Observation& observation, const Eigen::Matrix2d& cov_z);

  /// Divides a measurement by the estimated range scale.
  Measurement WithoutScale(const Measurement& measurement) const;

  /// An observation against a mode, both as positions in the vehicle frame.
  struct Prediction {
    Point point;
    Measurement measurement;
    Eigen::Vector2d nu = Eigen::Vector2d::Zero();     ///< Observed - expected position. [m]
    Eigen::Matrix2d S = Eigen::Matrix2d::Identity();  ///< Of nu. [m²]
    StateByPoint cov_state_z = StateByPoint::Zero();  ///< Of the state's error with z's.
    double nis = 0.0;  ///< νᵀ S⁻¹ ν >= 0; infinite if S cannot be inverted: it gates with nothing.

    bool usable() const { return nis < std::numeric_limits<double>::infinity(); }

    /// log of the density of z, in z's own units, with the errors of map and sensor as they were
    /// before the first observation; -∞ if not usable.
    double LogLikelihood() const {
      if (!usable()) return -std::numeric_limits<double>::infinity();
      return LogGaussian(nu, S) + measurement.log_m2_per_unit;
    }

    /// The largest that it could be, for nu = 0.
    double LogPeak() const { return usable() ? LogLikelihood() + 0.5 * nis : LogLikelihood(); }
  };

  /// Linearized at the present pose; or, where that is so vague that the second order of q matters,
  /// at the pose that the observation makes likeliest. A point that is relinearized stays as it is.
  Prediction PredictObservation(const Measurement& measurement, const Point& point) const;
  Prediction PredictObservation(const Observation& observation,
                                const Eigen::Matrix2d& cov_z,
                                ModeRef mode,
                                const MapSnapshot& snapshot) const {
    return PredictObservation(Measure(observation, cov_z), PredictPoint(mode, snapshot));
  }

  /// log p(z | all observations before), in z's own units; see SharedErrors. -∞ if the prediction
  /// is not usable.
  /// @param prediction  Of this filter in its present state, for the same mode.
  double LogLikelihood(const Prediction& prediction,
                       ModeRef mode,
                       const MapSnapshot& snapshot) const;

  /// Corrects the state with an observation of a mode.
  /// @param prediction  Of this filter in its present state, for the same mode; usable.
  /// @param weight  What one of several observations that are alike counts for LogLikelihood(), in
  ///                (0, 1].
  void Update(const Prediction& prediction,
              ModeRef mode,
              const MapSnapshot& snapshot,
              double weight = 1.0);

  /// Remembers a landmark at the place where this filter's pose puts an observation of it.
  /// @param p_odom_viewpoint  Where the vehicle is by dead reckoning. [m]
  void StartPlace(int group,
                  const Measurement& measurement,
                  const Eigen::Vector2d& p_odom_viewpoint);

  /// The place remembered for a group; null if there is none. Valid until the filter changes.
  const UnknownPlace* FindPlace(int group) const { return places_.Find(group); }
  void ErasePlace(int group);

  /// Takes a place over from another filter whose pose is about the same.
  void AdoptPlace(const UnknownPlace& place);

  /// As PredictObservation(), for a landmark that stands at a place.
  Prediction PredictPlace(const UnknownPlace& place, const Measurement& of) const;
  Point PredictPlace(const UnknownPlace& place) const;

  /// log p(z | all observations before) of a landmark at a place, as for a mode.
  double LogLikelihood(const Prediction& prediction,
                       const UnknownPlace& place,
                       const MapSnapshot& snapshot) const;

  /// Corrects a place with an observation of it; and the state, if it is certain.
  /// @param prediction  Of this filter in its present state, for the same place.
  /// @param weight      As for Update().
  /// @param certain     The landmark stands there. From then on state, modes and place are
  ///                    estimated together at each of its sightings, as by SharedErrors: the place
  ///                    holds the pose where nothing else does, and LogLikelihood() counts once
  ///                    what its sightings have in common.
  void UpdatePlace(const UnknownPlace& place,
                   const Prediction& prediction,
                   const MapSnapshot& snapshot,
                   double weight,
                   bool certain);

  PoseWithCovariance Pose() const;
  const Se2& T_map_vehicle() const { return T_map_vehicle_; }
  const Eigen::Matrix2d& R_vehicle_map() const { return R_vehicle_map_; }

  /// Deviation of (log scale_v, log scale_omega) from the fleet's, and log range scale.
  const Eigen::Vector3d& log_scale() const { return log_scale_; }

  /// Of (ξ, log scale_v, log scale_omega, log range scale).
  const StateMatrix& covariance() const { return P_; }

  /// Modes kept as considered.
  int considered_modes() const { return static_cast<int>(considered_.size()); }

 private:
  // The state's error is Σ gain · (mode error) + a part independent of the map. With the gains, and
  // not the cross-covariances, at hand, a mode used for the first time starts with the correlation
  // that the map's own covariance implies.
  //
  // What moves the state's error transforms all gains alike. Those of modes not used since the last
  // Predict() are left behind: the product of the transforms is theirs in common.
  struct ConsideredMode {
    int index = 0;  // Row in the snapshot's covariance().
    bool current = false;
    StateByPoint gain;  // If not current, times pending_.
  };

  // A considered bias of one kind of observation, in its units.
  struct SensorBias {
    Eigen::Matrix2d cov = Eigen::Matrix2d::Zero();
    StateByPoint cross = StateByPoint::Zero();  // E[(state error) (bias)ᵀ].
  };

  const SensorBias& BiasOf(Observation::Kind kind) const {
    return kind == Observation::Kind::kCartesian ? position_bias_ : range_bearing_bias_;
  }
  Prediction PredictLinear(const Measurement& of, const Point& point) const;
  bool IsNonlinear(const Measurement& measurement, const Point& point) const;
  static bool IsLinear(const Eigen::Vector3d& xi,
                       const Measurement& measurement,
                       const Point& point);
  // A point linearized at ξ = 0, linearized at another ξ.
  Point LinearizedAt(const Eigen::Vector3d& xi, const Point& point) const;
  Point PredictPoint(const Eigen::Vector2d& p_map_landmark,
                     const Eigen::Matrix2d& cov_p,
                     const StateByPoint& cross) const;
  using ConsideredModes = boost::container::static_vector<ConsideredMode, kMaxConsideredModes + 1>;

  // The first that is not before a mode.
  ConsideredModes::const_iterator Find(int mode_index) const;
  // E[(state error) (mode error)ᵀ].
  StateByPoint CrossOf(int mode_index, const JointCovariance& covariance) const;
  StateByPoint& GainOf(int mode_index);
  void TransformGains(const StateMatrix& M);
  // Adds a mode that shared_errors_ removed before, with its regression on what they hold.
  void Share(int mode_index, const SharedErrors::Observed& seen, const JointCovariance& covariance);
  // Replaces state, gains, biases and places by the estimate of shared_errors_. False if these have
  // lost their digits.
  bool AdoptSharedErrors(Observation::Kind kind, const JointCovariance& covariance);
  void AdoptGains(const JointCovariance& covariance);
  void ApplyGains();
  SharedErrors::Observed ObservedBy(const Prediction& prediction, int mode_index) const;
  SharedErrors::Observed ObservedAt(const UnknownPlace& place, const Prediction& prediction) const;
  double SharedLogLikelihood(const Prediction& prediction,
                             const SharedErrors::Observed& seen,
                             const MapSnapshot& snapshot) const;
  // Applies a correction. The errors stay as they are in the map frame, and so turn with the step
  // in the vehicle's: what an observation left unknown, a turn about the landmark, is then still
  // unknown to the next one. If the observation was linearized at the corrected pose, the right
  // Jacobian does this. Returns what the step makes of an error, for the gains.
  StateMatrix Move(const StateVector& correction, bool relinearized);
  void MarginalizeWeakest(int except);

  void MoveTo(const Se2& T_map_vehicle);
  bool IsSound() const;
  void StartAnewUnlessSound();

  Se2 T_map_vehicle_;
  Eigen::Matrix2d R_vehicle_map_;  // Of it.
  Eigen::Vector3d log_scale_ = Eigen::Vector3d::Zero();
  double sd_log_scale_ = 0.0;  // At the start.
  StateMatrix P_ = StateMatrix::Zero();
  SensorBias range_bearing_bias_;
  SensorBias position_bias_;
  ConsideredModes considered_;  // By index.
  StateMatrix pending_ = StateMatrix::Identity();
  SharedErrors shared_errors_;
  UnknownPlaces places_;
};

/// True if nobody knows where the vehicle is and where it looks.
bool IsNowhere(const PoseWithCovariance& pose);

}  // namespace shiftmap
