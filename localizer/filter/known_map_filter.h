// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

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

/// Extended Kalman filter for the pose of a vehicle on a map that is uncertain and not updated.
///
/// State: T_map_vehicle with the perturbation T·Exp(ξ), and the deviation of this vehicle's
/// (log scale_v, log scale_omega) from the fleet's calibration. Two things are *considered*
/// (Schmidt-Kalman), uncertain but not estimated: the errors of the modes, with the map's joint
/// covariance, and a constant bias of the sensor. A filter that took the map as exact would count
/// the error of a mode anew with each observation of it, and one without a bias would average away
/// what a camera that is mounted askew gets wrong. Equations: localizer/README.md.
///
/// Ownership: keeps no reference to the snapshot; every call must pass the same one.
/// Threads: const-safe. Cheap to copy: a few hundred bytes and 88 bytes per mode used.
class KnownMapFilter {
 public:
  static constexpr int kStates = 5;  ///< x, y, yaw, log scale_v, log scale_omega.
  using StateMatrix = Eigen::Matrix<double, kStates, kStates>;
  using StateByPoint = Eigen::Matrix<double, kStates, 2>;

  /// Modes kept as considered at most; beyond it the one that matters least is let go.
  static constexpr int kMaxConsideredModes = 64;

  /// Standard deviation of the sensor's bias over that of its noise.
  static constexpr double kBiasShare = 0.5;

  /// @param start  Independent of the map's errors.
  KnownMapFilter(const PoseWithCovariance& start, const Calibration& calibration);

  /// Moves on by an increment that was integrated with the fleet's calibration; corrects it, to
  /// first order, for what this vehicle's own was found to be.
  /// @param elapsed_s  Duration of the increment, for the random walk of the calibration. [s]
  void Predict(const MotionIncrement& increment, double elapsed_s);

  /// An observation against a mode.
  struct Prediction {
    Innovation innovation;
    Eigen::Matrix2d S = Eigen::Matrix2d::Identity();  ///< Of the innovation, in z's units.
    StateByPoint cov_state_z = StateByPoint::Zero();  ///< P Hᵀ: of the state with z.
    double nis = 0.0;                                 ///< νᵀ S⁻¹ ν.
    Observation::Kind kind = Observation::Kind::kRangeBearing;

    /// log N(ν; 0, S), a density in z's own units.
    double LogLikelihood() const { return LogGaussian(innovation.nu, S); }
  };
  Prediction PredictObservation(const Observation& observation,
                                const Eigen::Matrix2d& cov_z,
                                ModeRef mode,
                                const MapSnapshot& snapshot) const;

  /// Corrects the state with an observation of a mode.
  /// @param prediction  Of this filter in its present state, for the same mode.
  void Update(const Prediction& prediction, ModeRef mode, const MapSnapshot& snapshot);

  /// Where a mode is seen: (range, bearing) and its covariance without sensor noise.
  struct Sight {
    Eigen::Vector2d range_bearing;
    Eigen::Matrix2d cov;
  };
  Sight PredictSight(ModeRef mode, const MapSnapshot& snapshot) const;

  PoseWithCovariance Pose() const;
  const Se2& T_map_vehicle() const { return T_map_vehicle_; }

  /// Deviation of (log scale_v, log scale_omega) from the fleet's.
  const Eigen::Vector2d& log_scale() const { return log_scale_; }

  /// Of (ξ, log scale_v, log scale_omega).
  const StateMatrix& covariance() const { return P_; }

  /// Modes kept as considered.
  int considered_modes() const { return static_cast<int>(considered_.size()); }

 private:
  // The state's error is Σ gain · (mode error) + a part independent of the map. With the gains, and
  // not the cross-covariances, at hand, a mode used for the first time starts with the correlation
  // that the map's own covariance implies.
  struct ConsideredMode {
    int index = 0;  // Row in the snapshot's covariance().
    StateByPoint gain;
  };

  // A considered bias of one kind of observation, in its units.
  struct SensorBias {
    Eigen::Matrix2d cov = Eigen::Matrix2d::Zero();
    StateByPoint cross = StateByPoint::Zero();  // E[(state error) (bias)ᵀ].
  };

  const SensorBias& BiasOf(Observation::Kind kind) const {
    return kind == Observation::Kind::kCartesian ? position_bias_ : range_bearing_bias_;
  }
  // E[(state error) (mode error)ᵀ].
  StateByPoint CrossOf(int mode_index, const JointCovariance& covariance) const;
  StateByPoint& GainOf(int mode_index);
  void LetGoOfWeakest(int except);

  Se2 T_map_vehicle_;
  Eigen::Vector2d log_scale_ = Eigen::Vector2d::Zero();
  StateMatrix P_ = StateMatrix::Zero();
  SensorBias range_bearing_bias_;
  SensorBias position_bias_;
  std::vector<ConsideredMode> considered_;  // By index.
};

}  // namespace shiftmap
