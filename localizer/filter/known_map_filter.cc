// SPDX-License-Identifier: Apache-2.0
#include "localizer/filter/known_map_filter.h"

#include <Eigen/LU>
#include <algorithm>
#include <limits>

namespace shiftmap {
namespace {

// Wheels wear and loads shift: the log-scales may wander by this much per √s.
constexpr double kLogScaleWalk = 5e-4;

const Mode& ModeOf(const MapSnapshot& snapshot, ModeRef mode) {
  return snapshot.groups()[static_cast<std::size_t>(mode.group)]
      .modes[static_cast<std::size_t>(mode.state) - 1];
}

}  // namespace

KnownMapFilter::KnownMapFilter(const PoseWithCovariance& start, const Calibration& calibration)
    : T_map_vehicle_(start.T_map_vehicle) {
  const double sd_log_scale = calibration.odometry.sd_log_scale;
  P_.topLeftCorner<3, 3>() = start.cov_T_map_vehicle;
  P_.bottomRightCorner<2, 2>() = Eigen::Matrix2d::Identity() * (sd_log_scale * sd_log_scale);

  const SensorCalibration& sensor = calibration.sensor;
  const Eigen::Vector2d sd_z(sensor.sd_range_m, sensor.sd_bearing_rad);
  const Eigen::Vector2d sd_position = Eigen::Vector2d::Constant(sensor.sd_position_m);
  range_bearing_bias_.cov = (kBiasShare * sd_z).cwiseAbs2().asDiagonal();
  position_bias_.cov = (kBiasShare * sd_position).cwiseAbs2().asDiagonal();
}

void KnownMapFilter::Predict(const MotionIncrement& increment, double elapsed_s) {
  const Eigen::Matrix<double, 3, 2> J = increment.J_calibration.leftCols<2>();
  const Se2 T_begin_end = increment.T_begin_end * Se2::Exp(J * log_scale_);
  T_map_vehicle_ = T_map_vehicle_ * T_begin_end;

  StateMatrix F = StateMatrix::Identity();
  F.topLeftCorner<3, 3>() = T_begin_end.Inverse().Adjoint();
  F.topRightCorner<3, 2>() = J;
  P_ = F * P_ * F.transpose();
  P_.topLeftCorner<3, 3>() += increment.cov;
  P_.bottomRightCorner<2, 2>().diagonal().array() += kLogScaleWalk * kLogScaleWalk * elapsed_s;
  P_ = Symmetrized(P_);
  range_bearing_bias_.cross = F * range_bearing_bias_.cross;
  position_bias_.cross = F * position_bias_.cross;
  for (ConsideredMode& mode : considered_) mode.gain = F * mode.gain;
}

KnownMapFilter::StateByPoint KnownMapFilter::CrossOf(int mode_index,
                                                     const JointCovariance& covariance) const {
  StateByPoint cross = StateByPoint::Zero();
  for (const ConsideredMode& mode : considered_) {
    cross += mode.gain * covariance.Block(mode.index, mode_index);
  }
  return cross;
}

KnownMapFilter::StateByPoint& KnownMapFilter::GainOf(int mode_index) {
  const auto place =
      std::find_if(considered_.begin(), considered_.end(), [&](const ConsideredMode& mode) {
        return mode.index >= mode_index;
      });
  if (place != considered_.end() && place->index == mode_index) return place->gain;
  return considered_.insert(place, {mode_index, StateByPoint::Zero()})->gain;
}

void KnownMapFilter::LetGoOfWeakest(int except) {
  const auto weight = [&](const ConsideredMode& mode) {
    return mode.index == except ? std::numeric_limits<double>::infinity() : mode.gain.squaredNorm();
  };
  considered_.erase(
      std::min_element(considered_.begin(), considered_.end(), [&](const auto& a, const auto& b) {
        return weight(a) < weight(b);
      }));
}

KnownMapFilter::Prediction KnownMapFilter::PredictObservation(const Observation& observation,
                                                              const Eigen::Matrix2d& cov_z,
                                                              ModeRef mode,
                                                              const MapSnapshot& snapshot) const {
  const Mode& landmark = ModeOf(snapshot, mode);
  const StateByPoint cross =
      CrossOf(snapshot.ModeIndex(mode.group, mode.state), snapshot.covariance());
  Prediction prediction;
  prediction.innovation = Linearize(observation, T_map_vehicle_, landmark.p_map_landmark);
  const Eigen::Matrix<double, 2, 3>& H_x = prediction.innovation.H_pose;
  const Eigen::Matrix2d& H_m = prediction.innovation.H_landmark;

  const SensorBias& bias = BiasOf(observation.kind);
  prediction.kind = observation.kind;
  const StateByPoint cross_considered = cross * H_m.transpose() + bias.cross;
  prediction.cov_state_z = P_.leftCols<3>() * H_x.transpose() + cross_considered;
  const Eigen::Matrix2d H_x_cross = H_x * cross_considered.topRows<3>();
  prediction.S = H_x * P_.topLeftCorner<3, 3>() * H_x.transpose() + H_x_cross +
                 H_x_cross.transpose() + H_m * landmark.cov_p_map_landmark * H_m.transpose() +
                 bias.cov + cov_z;
  prediction.S = Symmetrized(prediction.S);
  prediction.nis = SquaredMahalanobis(prediction.innovation.nu, prediction.S);
  return prediction;
}

void KnownMapFilter::Update(const Prediction& prediction,
                            ModeRef mode,
                            const MapSnapshot& snapshot) {
  const int mode_index = snapshot.ModeIndex(mode.group, mode.state);
  const StateByPoint K = prediction.cov_state_z * prediction.S.inverse();
  const Eigen::Matrix<double, 2, 3>& H_x = prediction.innovation.H_pose;
  const Eigen::Matrix2d& H_m = prediction.innovation.H_landmark;

  const Eigen::Matrix<double, kStates, 1> correction = K * prediction.innovation.nu;
  T_map_vehicle_ = T_map_vehicle_ * Se2::Exp(correction.head<3>());
  log_scale_ += correction.tail<2>();

  // K is optimal for the state, so Joseph's form reduces to this.
  P_ -= K * prediction.S * K.transpose();
  P_ = Symmetrized(P_);
  const bool cartesian = prediction.kind == Observation::Kind::kCartesian;
  for (SensorBias* bias : {&range_bearing_bias_, &position_bias_}) {
    const bool observed = (bias == &position_bias_) == cartesian;
    Eigen::Matrix2d cov_z_bias = H_x * bias->cross.topRows<3>();
    if (observed) cov_z_bias += bias->cov;
    bias->cross -= K * cov_z_bias;
  }
  for (ConsideredMode& considered : considered_) {
    considered.gain -= K * (H_x * considered.gain.topRows<3>());
  }
  GainOf(mode_index) -= K * H_m;
  if (considered_modes() > kMaxConsideredModes) LetGoOfWeakest(mode_index);
}

KnownMapFilter::Sight KnownMapFilter::PredictSight(ModeRef mode,
                                                   const MapSnapshot& snapshot) const {
  Observation origin;  // z = 0, so that the innovation is -h.
  origin.kind = Observation::Kind::kRangeBearing;
  const Prediction prediction = PredictObservation(origin, Eigen::Matrix2d::Zero(), mode, snapshot);
  return {-prediction.innovation.nu, prediction.S};
}

PoseWithCovariance KnownMapFilter::Pose() const {
  return {T_map_vehicle_, P_.topLeftCorner<3, 3>()};
}

}  // namespace shiftmap
