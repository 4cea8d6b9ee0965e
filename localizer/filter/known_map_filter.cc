// SPDX-License-Identifier: Apache-2.0
#include "localizer/filter/known_map_filter.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "localizer/filter/well_conditioned.h"
#include "mapstore/core/magnitude.h"

namespace shiftmap {
namespace {

// Wheels wear and loads shift: log-scales of odometry may wander by this much per √s.
constexpr double kLogScaleWalk = 5e-4;

// Correlation time of the log range scale, an Ornstein-Uhlenbeck process about 0. [s]
// The data hardly observe a common drift of this scale, that of odometry and that of the map, which
// linearization errors cause.
constexpr double kRangeScaleTime = 300.0;

// A mode that is known less exactly than this share of its distance is not where dq/dz is taken.
constexpr double kVagueShare = 0.2;

// Takes dq/dz at a position. The range in it is a bound on the true one rather than that of the
// position, which may be about zero.
void LinearizeAt(const Eigen::Vector2d& q, KnownMapFilter::Measurement* measurement) {
  const double squared = q.squaredNorm();
  const double norm = std::sqrt(squared);
  const double range = std::sqrt(squared + measurement->cov_z(0, 0));
  const double c = norm > 0.0 ? q.x() / norm : 1.0;
  const double s = norm > 0.0 ? q.y() / norm : 0.0;
  measurement->dq_dz << c, -range * s, s, range * c;
  measurement->cov_noise = measurement->dq_dz * measurement->cov_z * measurement->dq_dz.transpose();
}

// Where a mode is expected, dq/dz does not depend on the noise of z. At the measured bearing it
// would, and so would the gain: a vehicle that stands drifts about the landmark that it sees.
void LinearizeAt(const KnownMapFilter::Point& point, KnownMapFilter::Measurement* measurement) {
  const bool vague = point.relinearized ||
                     !(point.cov_q.trace() < kVagueShare * kVagueShare * point.q.squaredNorm());
  if (measurement->kind == Observation::Kind::kCartesian || vague) return;
  LinearizeAt(point.q, measurement);
}

const Mode& ModeOf(const MapSnapshot& snapshot, ModeRef mode) {
  return snapshot.groups()[static_cast<std::size_t>(mode.group)]
      .modes[static_cast<std::size_t>(mode.state) - 1];
}

// Second order of q over the noise from which on an observation is linearized where it puts the
// pose.
constexpr double kMaxSecondOrder = 0.1;

// H X for the Jacobian H of an observed position by the state. Skips the zeros and ones of H.
Eigen::Matrix2d TimesJacobian(const KnownMapFilter::Point& point,
                              const KnownMapFilter::StateByPoint& X) {
  Eigen::Matrix2d product = point.H_range_scale * X.row(KnownMapFilter::kRangeScale);
  if (point.relinearized) {
    product += point.H_pose * X.topRows<3>();
  } else {
    const Eigen::Vector2d& q = point.q;
    product.row(0) += X.row(2) * q.y() - X.row(0);
    product.row(1) += X.row(2) * -q.x() - X.row(1);
  }
  return product;
}

// X <- [A_pose 0; 0 I] X for A_pose = [R p; 0 0 1].
template <typename Columns>
void MovePose(const Eigen::Matrix3d& A_pose, Columns* X) {
  const Eigen::Matrix<double, 2, 3> A = A_pose.topRows<2>();
  for (Eigen::Index j = 0; j < Columns::ColsAtCompileTime; ++j) {
    const Eigen::Vector2d moved =
        A.col(0) * (*X)(0, j) + A.col(1) * (*X)(1, j) + A.col(2) * (*X)(2, j);
    X->col(j).template head<2>() = moved;
  }
}

// P Hᵀ for the same H.
KnownMapFilter::StateByPoint CovarianceWithState(const KnownMapFilter::StateMatrix& P,
                                                 const KnownMapFilter::Point& point) {
  KnownMapFilter::StateByPoint product =
      P.col(KnownMapFilter::kRangeScale) * point.H_range_scale.transpose();
  if (point.relinearized) {
    product += P.leftCols<3>() * point.H_pose.transpose();
  } else {
    product.col(0) += P.col(2) * point.q.y() - P.col(0);
    product.col(1) += P.col(2) * -point.q.x() - P.col(1);
  }
  return product;
}

// The columns of the pose and of the range scale; those of the scales of odometry are unit ones.
using CorrectionColumns = Eigen::Matrix<double, KnownMapFilter::kStates, 4>;

// X <- T X: what a correction makes of errors.
template <typename Columns>
void Correct(const CorrectionColumns& T, Columns* X) {
  for (Eigen::Index j = 0; j < Columns::ColsAtCompileTime; ++j) {
    Eigen::Matrix<double, KnownMapFilter::kStates, 1> corrected =
        T.col(0) * (*X)(0, j) + T.col(1) * (*X)(1, j) + T.col(2) * (*X)(2, j) +
        T.col(3) * (*X)(KnownMapFilter::kRangeScale, j);
    corrected(3) += (*X)(3, j);
    corrected(4) += (*X)(4, j);
    X->col(j) = corrected;
  }
}

KnownMapFilter::StateMatrix StartCovariance(const PoseWithCovariance& start, double sd_log_scale) {
  KnownMapFilter::StateMatrix P = KnownMapFilter::StateMatrix::Zero();
  P.topLeftCorner<3, 3>() = start.cov_T_map_vehicle;
  P.diagonal().tail<3>() =
      Eigen::Vector3d(sd_log_scale, sd_log_scale, KnownMapFilter::kSdLogRangeScale).cwiseAbs2();
  return P;
}

// False if it is not a number.
bool WithinMagnitude(double value) { return std::abs(value) <= kMaxMagnitude; }

// The leading minors of the pose's covariance are positive. A comparison with NaN is false.
bool IsSoundCovariance(const KnownMapFilter::StateMatrix& P) {
  const double xx_yy = P(0, 0) * P(1, 1) - P(0, 1) * P(0, 1);
  const double xy_yw = P(0, 1) * P(1, 2) - P(1, 1) * P(0, 2);
  const double xx_yw = P(0, 0) * P(1, 2) - P(0, 1) * P(0, 2);
  const double determinant = P(2, 2) * xx_yy - P(1, 2) * xx_yw + P(0, 2) * xy_yw;
  constexpr double kMaxVariance = KnownMapFilter::kMaxPositionSd * KnownMapFilter::kMaxPositionSd;
  constexpr double kMaxYawVariance = KnownMapFilter::kMaxYawSd * KnownMapFilter::kMaxYawSd;
  return P(0, 0) > 0.0 && xx_yy > 0.0 && determinant > 0.0 && P(3, 3) > 0.0 && P(4, 4) > 0.0 &&
         P(5, 5) > 0.0 && P(0, 0) + P(1, 1) < kMaxVariance && P(2, 2) < kMaxYawVariance &&
         P(3, 3) + P(4, 4) + P(5, 5) < kMaxMagnitude;
}

// A covariance without the negative eigenvalues that rounding leaves.
Eigen::Matrix2d NonNegative(const Eigen::Matrix2d& cov) {
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> solver;
  solver.computeDirect(cov);
  const Eigen::Matrix2d& V = solver.eigenvectors();
  return V * solver.eigenvalues().cwiseMax(0.0).asDiagonal() * V.transpose();
}

void SetNis(KnownMapFilter::Prediction* prediction) {
  prediction->nis = IsWellConditioned(prediction->S)
                        ? SquaredMahalanobis(prediction->nu, prediction->S)
                        : std::numeric_limits<double>::infinity();
  if (!(prediction->nis >= 0.0)) prediction->nis = std::numeric_limits<double>::infinity();
}

}  // namespace

KnownMapFilter::KnownMapFilter(const PoseWithCovariance& start, const Calibration& calibration)
    : T_map_vehicle_(start.T_map_vehicle),
      R_vehicle_map_(start.T_map_vehicle.Rotation().transpose()),
      sd_log_scale_(calibration.odometry.sd_log_scale),
      P_(StartCovariance(start, sd_log_scale_)),
      shared_errors_(P_) {
  const SensorCalibration& sensor = calibration.sensor;
  const Eigen::Vector2d sd_z(sensor.sd_range_m, sensor.sd_bearing_rad);
  const Eigen::Vector2d sd_position = Eigen::Vector2d::Constant(sensor.sd_position_m);
  range_bearing_bias_.cov = (kBiasShare * sd_z).cwiseAbs2().asDiagonal();
  position_bias_.cov = (kBiasShare * sd_position).cwiseAbs2().asDiagonal();
  StartAnewUnlessSound();
}

bool KnownMapFilter::IsSound() const {
  const Eigen::Vector2d& t = T_map_vehicle_.translation();
  return WithinMagnitude(t.x()) && WithinMagnitude(t.y()) && std::isfinite(T_map_vehicle_.yaw()) &&
         WithinMagnitude(log_scale_.x()) && WithinMagnitude(log_scale_.y()) &&
         WithinMagnitude(log_scale_.z()) && IsSoundCovariance(P_);
}

void KnownMapFilter::StartAnewUnlessSound() {
  if (IsSound()) return;
  const Eigen::Vector2d& t = T_map_vehicle_.translation();
  const bool finite =
      WithinMagnitude(t.x()) && WithinMagnitude(t.y()) && std::isfinite(T_map_vehicle_.yaw());
  constexpr double kVariance = kUnknownPositionSd * kUnknownPositionSd;
  constexpr double kYawVariance = std::numbers::pi * std::numbers::pi;
  const PoseWithCovariance unknown{
      finite ? T_map_vehicle_ : Se2(),
      Eigen::Vector3d(kVariance, kVariance, kYawVariance).asDiagonal()};
  MoveTo(unknown.T_map_vehicle);
  log_scale_.setZero();
  P_ = StartCovariance(unknown, sd_log_scale_);
  range_bearing_bias_.cross.setZero();
  position_bias_.cross.setZero();
  considered_.clear();
  pending_.setIdentity();
  shared_errors_ = SharedErrors(P_);
  places_ = UnknownPlaces();
}

bool IsNowhere(const PoseWithCovariance& pose) {
  constexpr double kVariance =
      KnownMapFilter::kUnknownPositionSd * KnownMapFilter::kUnknownPositionSd;
  const Eigen::Matrix3d& cov = pose.cov_T_map_vehicle;
  return cov(0, 0) + cov(1, 1) >= kVariance && cov(2, 2) >= 1.0;
}

void KnownMapFilter::MoveTo(const Se2& T_map_vehicle) {
  T_map_vehicle_ = T_map_vehicle;
  R_vehicle_map_ = T_map_vehicle.Rotation().transpose();
}

void KnownMapFilter::Predict(const MotionIncrement& increment, double elapsed_s) {
  const Eigen::Matrix<double, 3, 2> J = increment.J_calibration.leftCols<2>();
  const Se2 T_begin_end = increment.T_begin_end * Se2::Exp(J * log_scale_.head<2>());
  MoveTo(T_map_vehicle_ * T_begin_end);

  const double kept = std::exp(-elapsed_s / kRangeScaleTime);
  log_scale_.z() *= kept;

  StateMatrix F = StateMatrix::Identity();
  F.topLeftCorner<3, 3>() = T_begin_end.InverseAdjoint();
  F.block<3, 2>(0, 3) = J;
  F(kRangeScale, kRangeScale) = kept;
  StateMatrix Q = StateMatrix::Zero();
  Q.topLeftCorner<3, 3>() = increment.cov;
  Q.diagonal().segment<2>(3).setConstant(kLogScaleWalk * kLogScaleWalk * elapsed_s);
  Q(kRangeScale, kRangeScale) = kSdLogRangeScale * kSdLogRangeScale * (1.0 - kept * kept);
  P_ = Symmetrized(StateMatrix(F * P_ * F.transpose() + Q));
  shared_errors_.Predict(F, Q, elapsed_s);
  range_bearing_bias_.cross = F * range_bearing_bias_.cross;
  position_bias_.cross = F * position_bias_.cross;
  TransformGains(F);
  ApplyGains();
  for (UnknownPlace& place : places_) place.cross_state = (F * place.cross_state).eval();
  StartAnewUnlessSound();
}

void KnownMapFilter::TransformGains(const StateMatrix& M) {
  pending_ = (M * pending_).eval();
  for (ConsideredMode& mode : considered_) {
    if (mode.current) mode.gain = (M * mode.gain).eval();
  }
}

void KnownMapFilter::ApplyGains() {
  for (ConsideredMode& mode : considered_) {
    if (!mode.current) mode.gain = (pending_ * mode.gain).eval();
    mode.current = false;
  }
  pending_.setIdentity();
}

KnownMapFilter::StateByPoint KnownMapFilter::CrossOf(int mode_index,
                                                     const JointCovariance& covariance) const {
  if (covariance.cross_blocks().empty()) {
    const auto mode = Find(mode_index);
    if (mode == considered_.end() || mode->index != mode_index) return StateByPoint::Zero();
    const StateByPoint cross = mode->gain * covariance.Block(mode_index, mode_index);
    return mode->current ? cross : pending_ * cross;
  }
  StateByPoint of_current = StateByPoint::Zero();
  StateByPoint of_others = StateByPoint::Zero();
  const auto add = [&](const ConsideredMode& mode) {
    (mode.current ? of_current : of_others) += mode.gain * covariance.Block(mode.index, mode_index);
  };
  std::for_each(considered_.begin(), considered_.end(), add);
  return of_current + pending_ * of_others;
}

KnownMapFilter::ConsideredModes::const_iterator KnownMapFilter::Find(int mode_index) const {
  return std::lower_bound(considered_.begin(),
                          considered_.end(),
                          mode_index,
                          [](const ConsideredMode& mode, int index) { return mode.index < index; });
}

KnownMapFilter::StateByPoint& KnownMapFilter::GainOf(int mode_index) {
  const auto place = considered_.begin() + (Find(mode_index) - considered_.cbegin());
  if (place == considered_.end() || place->index != mode_index) {
    return considered_.insert(place, {mode_index, true, StateByPoint::Zero()})->gain;
  }
  if (!place->current) place->gain = (pending_ * place->gain).eval();
  place->current = true;
  return place->gain;
}

void KnownMapFilter::MarginalizeWeakest(int except) {
  ApplyGains();
  const auto weight = [&](const ConsideredMode& mode) {
    return mode.index == except ? std::numeric_limits<double>::infinity() : mode.gain.squaredNorm();
  };
  considered_.erase(
      std::min_element(considered_.begin(), considered_.end(), [&](const auto& a, const auto& b) {
        return weight(a) < weight(b);
      }));
}

KnownMapFilter::Point KnownMapFilter::PredictPoint(ModeRef mode,
                                                   const MapSnapshot& snapshot) const {
  const Mode& landmark = ModeOf(snapshot, mode);
  return PredictPoint(landmark.p_map_landmark,
                      landmark.cov_p_map_landmark,
                      CrossOf(snapshot.ModeIndex(mode.group, mode.state), snapshot.covariance()));
}

KnownMapFilter::Point KnownMapFilter::PredictPoint(const Eigen::Vector2d& p_map_landmark,
                                                   const Eigen::Matrix2d& cov_p,
                                                   const StateByPoint& cross) const {
  Point point;
  point.q = R_vehicle_map_ * (p_map_landmark - T_map_vehicle_.translation());
  point.q_linear = point.q;
  point.H_pose << -1.0, 0.0, point.q.y(), 0.0, -1.0, -point.q.x();
  point.H_range_scale = point.q;
  point.H_landmark = R_vehicle_map_;
  const StateByPoint cross_q = cross * point.H_landmark.transpose();
  const StateByPoint cov_state = CovarianceWithState(P_, point);
  point.cov_state_q = cov_state + cross_q;
  const Eigen::Matrix2d H_cross = TimesJacobian(point, cross_q);
  point.cov_q = TimesJacobian(point, cov_state) + H_cross + H_cross.transpose() +
                point.H_landmark * cov_p * point.H_landmark.transpose();
  point.cov_q = Symmetrized(point.cov_q);
  return point;
}

KnownMapFilter::Measurement KnownMapFilter::WithoutScale(const Measurement& measurement) const {
  const double shrink = std::exp(-log_scale_.z());
  Measurement unscaled = measurement;
  unscaled.q *= shrink;
  unscaled.log_m2_per_unit -= 2.0 * log_scale_.z();
  if (measurement.kind == Observation::Kind::kCartesian) {
    unscaled.cov_z *= shrink * shrink;
    unscaled.cov_noise = unscaled.cov_z;
  } else {
    unscaled.cov_z.row(0) *= shrink;
    unscaled.cov_z.col(0) *= shrink;
    LinearizeAt(unscaled.q, &unscaled);
  }
  return unscaled;
}

KnownMapFilter::Measurement KnownMapFilter::Measure(const Observation& observation,
                                                    const Eigen::Matrix2d& cov_z) {
  Measurement measurement;
  measurement.q = observation.PositionInVehicle();
  measurement.cov_z = cov_z;
  measurement.log_m2_per_unit = std::log(SquareMetresPerUnit(observation));
  measurement.kind = observation.kind;
  if (observation.kind == Observation::Kind::kCartesian) {
    measurement.dq_dz.setIdentity();
    measurement.cov_noise = cov_z;
  } else {
    LinearizeAt(measurement.q, &measurement);
  }
  return measurement;
}

// By the second order of Exp(-ξ) q, ½ [θ]² (t + θ × q), at one standard deviation.
bool KnownMapFilter::IsNonlinear(const Measurement& measurement, const Point& point) const {
  const double yaw = P_(2, 2);
  const double second_order = 0.25 * yaw * (P_(0, 0) + P_(1, 1) + yaw * point.q.squaredNorm());
  return second_order > kMaxSecondOrder * kMaxSecondOrder * measurement.cov_noise.trace();
}

// By the second order of a correction, as above.
bool KnownMapFilter::IsLinear(const Eigen::Vector3d& xi,
                              const Measurement& measurement,
                              const Point& point) {
  const double turn = std::abs(xi.z());
  const double second_order = 0.5 * turn * (xi.head<2>().norm() + turn * point.q.norm());
  return second_order * second_order <
         kMaxSecondOrder * kMaxSecondOrder * measurement.cov_noise.trace();
}

KnownMapFilter::Point KnownMapFilter::LinearizedAt(const Eigen::Vector3d& xi,
                                                   const Point& point) const {
  const Se2 T_here_there = Se2::Exp(xi);
  const Eigen::Matrix2d R = T_here_there.Rotation().transpose();
  const Eigen::Vector2d q = T_here_there.Inverse() * point.q;
  // What comes of the mode: its error's covariance with the state's, and its own.
  const StateByPoint cov_state = CovarianceWithState(P_, point);
  const StateByPoint cross_q = point.cov_state_q - cov_state;
  const Eigen::Matrix2d H_cross = TimesJacobian(point, cross_q);
  const Eigen::Matrix2d cov_mode =
      point.cov_q - TimesJacobian(point, cov_state) - H_cross - H_cross.transpose();

  Point there;
  there.q = point.q;
  there.relinearized = true;
  there.H_pose << -1.0, 0.0, q.y(), 0.0, -1.0, -q.x();
  there.q_linear = q - there.H_pose * xi;
  there.H_pose = (there.H_pose * Se2::RightJacobian(xi)).eval();
  there.H_range_scale = q;
  there.H_landmark = R * point.H_landmark;
  const StateByPoint cross_there = cross_q * R.transpose();
  const StateByPoint state_there = CovarianceWithState(P_, there);
  there.cov_state_q = state_there + cross_there;
  const Eigen::Matrix2d H_cross_there = TimesJacobian(there, cross_there);
  there.cov_q = TimesJacobian(there, state_there) + H_cross_there + H_cross_there.transpose() +
                R * cov_mode * R.transpose();
  there.cov_q = Symmetrized(there.cov_q);
  return there;
}

// Gauss-Newton for the correction that is likeliest given the observation. Where it does not come
// to rest, the linearization at the present pose has to do.
KnownMapFilter::Prediction KnownMapFilter::PredictObservation(const Measurement& measurement,
                                                              const Point& point) const {
  constexpr double kMaxNis = 50.0;   // What is farther out is not looked at again.
  constexpr double kMaxTurn = 1.0;   // [rad]
  constexpr double kMaxStep = 0.01;  // The last one, in standard deviations of the pose.
  constexpr int kIterations = 6;
  const Prediction here = PredictLinear(measurement, point);
  if (point.relinearized || !(here.nis < kMaxNis) || !IsNonlinear(measurement, point)) return here;
  const Eigen::Array3d sd = P_.diagonal().head<3>().cwiseSqrt();
  Eigen::Vector3d xi = Eigen::Vector3d::Zero();
  Prediction there = here;
  for (int i = 0; i < kIterations; ++i) {
    const Eigen::Vector3d next = there.cov_state_z.topRows<3>() * there.S.inverse() * there.nu;
    if (!(std::abs(next.z()) < kMaxTurn)) return here;
    // A point that follows the noise of the observation would, as LinearizeAt() says, make a pose
    // drift where a landmark leaves it vague.
    if (i == 0 && IsLinear(next, measurement, point)) return here;
    const bool rests = ((next - xi).array().abs() < kMaxStep * sd).all();
    xi = next;
    there = PredictLinear(measurement, LinearizedAt(xi, point));
    if (!there.usable()) return here;
    if (rests) return there;
  }
  return here;
}

KnownMapFilter::Prediction KnownMapFilter::PredictLinear(const Measurement& of,
                                                         const Point& point) const {
  Prediction prediction;
  prediction.point = point;
  prediction.measurement = WithoutScale(of);
  Measurement& measurement = prediction.measurement;
  LinearizeAt(point, &measurement);
  prediction.nu = measurement.q - point.q_linear;

  const SensorBias& bias = BiasOf(measurement.kind);
  const Eigen::Matrix2d& dq_dz = measurement.dq_dz;
  const StateByPoint cross_bias = bias.cross * dq_dz.transpose();
  const Eigen::Matrix2d H_cross = TimesJacobian(point, cross_bias);
  prediction.cov_state_z = point.cov_state_q + cross_bias;
  prediction.S = point.cov_q + H_cross + H_cross.transpose() +
                 dq_dz * bias.cov * dq_dz.transpose() + measurement.cov_noise;
  prediction.S = Symmetrized(prediction.S);
  SetNis(&prediction);
  return prediction;
}

SharedErrors::Observed KnownMapFilter::ObservedBy(const Prediction& prediction,
                                                  int mode_index) const {
  SharedErrors::Observed observed;
  observed.mode_index = mode_index;
  observed.kind = prediction.measurement.kind;
  observed.nu = prediction.nu;
  observed.H_pose = prediction.point.H_pose;
  observed.H_range_scale = prediction.point.H_range_scale;
  observed.H_bias = prediction.measurement.dq_dz;
  observed.H_mode = prediction.point.H_landmark;
  const SensorBias& bias = BiasOf(observed.kind);
  observed.cov_bias = bias.cov;
  observed.cov_noise = prediction.measurement.cov_noise;
  if (!shared_errors_.HasBias(observed.kind) && !bias.cross.isZero(0.0)) {
    const StateByPoint on_state = P_.ldlt().solve(bias.cross);
    observed.bias_on_state = on_state.transpose();
    observed.cov_bias_rest = NonNegative(bias.cov - on_state.transpose() * bias.cross);
  }
  return observed;
}

double KnownMapFilter::LogLikelihood(const Prediction& prediction,
                                     ModeRef mode,
                                     const MapSnapshot& snapshot) const {
  const int mode_index = snapshot.ModeIndex(mode.group, mode.state);
  return SharedLogLikelihood(prediction, ObservedBy(prediction, mode_index), snapshot);
}

double KnownMapFilter::SharedLogLikelihood(const Prediction& prediction,
                                           const SharedErrors::Observed& seen,
                                           const MapSnapshot& snapshot) const {
  if (!prediction.usable()) return prediction.LogLikelihood();
  const double log_p = shared_errors_.LogLikelihood(seen, snapshot.covariance());
  // Where the shared errors have lost their digits, they count as unknown.
  if (!std::isfinite(log_p)) return prediction.LogLikelihood();
  return log_p + prediction.measurement.log_m2_per_unit;
}

void KnownMapFilter::Update(const Prediction& prediction,
                            ModeRef mode,
                            const MapSnapshot& snapshot,
                            double weight) {
  const int mode_index = snapshot.ModeIndex(mode.group, mode.state);
  SharedErrors::Observed seen = ObservedBy(prediction, mode_index);
  seen.cov_noise /= weight;
  const auto considered_mode = Find(mode_index);
  const bool known = considered_mode != considered_.end() && considered_mode->index == mode_index;
  if (known && !shared_errors_.Has(mode_index)) Share(mode_index, seen, snapshot.covariance());
  const bool taken = shared_errors_.Update(seen, snapshot.covariance());
  const StateByPoint K = prediction.cov_state_z * prediction.S.inverse();
  const Eigen::Matrix2d& H_m = prediction.point.H_landmark;

  // K is optimal for the state, so Joseph's form reduces to this.
  const StateByPoint KS = K * prediction.S;
  for (int j = 0; j < kStates; ++j) P_.col(j) -= KS.col(0) * K(j, 0) + KS.col(1) * K(j, 1);
  const bool cartesian = prediction.measurement.kind == Observation::Kind::kCartesian;
  for (SensorBias* bias : {&range_bearing_bias_, &position_bias_}) {
    const bool observed = (bias == &position_bias_) == cartesian;
    Eigen::Matrix2d cov_z_bias = TimesJacobian(prediction.point, bias->cross);
    if (observed) cov_z_bias += prediction.measurement.dq_dz * bias->cov;
    bias->cross -= K * cov_z_bias;
  }
  // I - K H.
  CorrectionColumns T = CorrectionColumns::Identity();
  T.col(3) = StateVector::Unit(kRangeScale);
  T.leftCols<3>() -= K * prediction.point.H_pose;
  T.col(3) -= K * prediction.point.H_range_scale;
  const Eigen::Matrix3d A_pose =
      Move(K * prediction.nu, prediction.point.relinearized).topLeftCorner<3, 3>();
  MovePose(A_pose, &T);
  Correct(T, &pending_);
  for (ConsideredMode& considered : considered_) {
    if (considered.current) Correct(T, &considered.gain);
  }
  StateByPoint AK = K;
  MovePose(A_pose, &AK);
  const StateByPoint AK_bias = AK * prediction.measurement.dq_dz;
  for (UnknownPlace& place : places_) {
    Correct(T, &place.cross_state);
    place.cross_state -= AK_bias * place.CrossBias(prediction.measurement.kind);
  }
  GainOf(mode_index) -= AK * H_m;
  if (considered_modes() > kMaxConsideredModes) MarginalizeWeakest(mode_index);
  StartAnewUnlessSound();
  if (!taken) shared_errors_ = SharedErrors(P_);
}

KnownMapFilter::StateMatrix KnownMapFilter::Move(const StateVector& correction, bool relinearized) {
  const Se2 step = Se2::Exp(correction.head<3>());
  MoveTo(T_map_vehicle_ * step);
  log_scale_ += correction.tail<3>();
  StateMatrix A = StateMatrix::Identity();
  const Eigen::Matrix3d A_pose =
      relinearized ? Se2::RightJacobian(correction.head<3>()) : step.InverseAdjoint();
  A.topLeftCorner<3, 3>() = A_pose;
  MovePose(A_pose, &P_);
  P_.transposeInPlace();
  MovePose(A_pose, &P_);
  P_ = Symmetrized(P_);
  shared_errors_.Move(A, correction);
  MovePose(A_pose, &range_bearing_bias_.cross);
  MovePose(A_pose, &position_bias_.cross);
  return A;
}

// What ν = H_x x̃ + H_p p̃ + b' + v = 0 leaves of p̃, if nothing was known of it before.
void KnownMapFilter::StartPlace(int group,
                                const Measurement& measurement,
                                const Eigen::Vector2d& p_odom_viewpoint) {
  const Eigen::Matrix2d R_map_vehicle = R_vehicle_map_.transpose();
  UnknownPlace place;
  place.group = group;
  place.kind = measurement.kind;
  place.p_map_landmark = T_map_vehicle_ * WithoutScale(measurement).q;
  place.p_odom_viewpoint = p_odom_viewpoint;
  const Prediction prediction =
      PredictLinear(measurement, PredictPoint(place.p_map_landmark, place.cov, place.cross_state));
  const SensorBias& bias = BiasOf(measurement.kind);
  const Eigen::Matrix2d cov_bias_z = TimesJacobian(prediction.point, bias.cross).transpose() +
                                     bias.cov * prediction.measurement.dq_dz.transpose();
  place.cov = R_map_vehicle * prediction.S * R_vehicle_map_;
  place.cross_state = -prediction.cov_state_z * R_vehicle_map_;
  place.cross_bias = -cov_bias_z * R_vehicle_map_;
  AdoptPlace(place);
}

void KnownMapFilter::AdoptPlace(const UnknownPlace& place) {
  shared_errors_.Forget(SharedErrors::PlaceIndex(place.group));
  places_.Put(place);
}

void KnownMapFilter::ErasePlace(int group) {
  shared_errors_.Forget(SharedErrors::PlaceIndex(group));
  places_.Erase(group);
}

KnownMapFilter::Point KnownMapFilter::PredictPlace(const UnknownPlace& place) const {
  return PredictPoint(place.p_map_landmark, place.cov, place.cross_state);
}

KnownMapFilter::Prediction KnownMapFilter::PredictPlace(const UnknownPlace& place,
                                                        const Measurement& of) const {
  Prediction prediction = PredictLinear(of, PredictPlace(place));
  const Measurement& measurement = prediction.measurement;
  const Eigen::Matrix2d cross =
      measurement.dq_dz * place.CrossBias(measurement.kind) * R_vehicle_map_.transpose();
  prediction.S += cross + cross.transpose();
  // Errors of modes that pose and place share are left out, and may leave less than the noise.
  const Eigen::Matrix2d more = prediction.S - measurement.cov_noise;
  if (more.trace() < 0.0 || more.determinant() < 0.0) prediction.S = measurement.cov_noise;
  SetNis(&prediction);
  return prediction;
}

SharedErrors::Observed KnownMapFilter::ObservedAt(const UnknownPlace& place,
                                                  const Prediction& prediction) const {
  SharedErrors::Observed seen = ObservedBy(prediction, SharedErrors::PlaceIndex(place.group));
  seen.nu += prediction.point.H_landmark * (place.p_map_landmark - place.p_shared);
  return seen;
}

double KnownMapFilter::LogLikelihood(const Prediction& prediction,
                                     const UnknownPlace& place,
                                     const MapSnapshot& snapshot) const {
  if (!shared_errors_.Has(SharedErrors::PlaceIndex(place.group))) return prediction.LogLikelihood();
  return SharedLogLikelihood(prediction, ObservedAt(place, prediction), snapshot);
}

void KnownMapFilter::UpdatePlace(const UnknownPlace& place,
                                 const Prediction& prediction,
                                 const MapSnapshot& snapshot,
                                 double weight,
                                 bool certain) {
  UnknownPlace corrected = place;
  const bool shared = shared_errors_.Has(SharedErrors::PlaceIndex(place.group));
  if (certain && !shared) corrected.p_shared = place.p_map_landmark;
  if (certain || shared) {
    SharedErrors::Observed seen = ObservedAt(corrected, prediction);
    seen.cov_noise /= weight;
    places_.Put(corrected);
    if (shared_errors_.Update(seen, snapshot.covariance()) &&
        AdoptSharedErrors(seen.kind, snapshot.covariance())) {
      return;
    }
    shared_errors_ = SharedErrors(P_);
  }
  const Measurement& measurement = prediction.measurement;
  const Eigen::Matrix2d& H_p = prediction.point.H_landmark;
  const SensorBias& bias = BiasOf(measurement.kind);
  const Eigen::Matrix2d cross_bias = place.CrossBias(measurement.kind);
  const Eigen::Matrix2d S = prediction.S + (1.0 / weight - 1.0) * measurement.cov_noise;
  const Eigen::Matrix2d cov_place_z =
      TimesJacobian(prediction.point, place.cross_state).transpose() + place.cov * H_p.transpose() +
      cross_bias.transpose() * measurement.dq_dz.transpose();
  const Eigen::Matrix2d cov_bias_z = TimesJacobian(prediction.point, bias.cross).transpose() +
                                     cross_bias * H_p.transpose() +
                                     bias.cov * measurement.dq_dz.transpose();
  const Eigen::Matrix2d K = cov_place_z * S.inverse();
  corrected.p_map_landmark += K * prediction.nu;
  corrected.cov = Symmetrized(Eigen::Matrix2d(place.cov - K * S * K.transpose()));
  corrected.cross_state -= prediction.cov_state_z * K.transpose();
  if (place.kind == measurement.kind) corrected.cross_bias -= cov_bias_z * K.transpose();
  places_.Put(corrected);
}

// By the regression on the errors of state, bias and the modes in use there.
void KnownMapFilter::Share(int mode_index,
                           const SharedErrors::Observed& seen,
                           const JointCovariance& covariance) {
  constexpr int kMax = SharedErrors::kMaxRows;
  using Square = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMax, kMax>;
  using ByPoint = Eigen::Matrix<double, Eigen::Dynamic, 2, 0, kMax, 2>;
  shared_errors_.MakeRoom();
  shared_errors_.UseBiasOf(seen);
  const int rows = shared_errors_.rows();
  // A place keeps the rows of the identity: its covariance with the modes is unknown.
  Square cov = Square::Identity(rows, rows);
  ByPoint cross = ByPoint::Zero(rows, 2);
  constexpr int kBias = SharedErrors::kBiasRow;
  cov.topLeftCorner<kStates, kStates>() = P_;
  cov.block<2, 2>(kBias, kBias) = seen.cov_bias;
  cov.block<kStates, 2>(0, kBias) = BiasOf(seen.kind).cross;
  cross.topRows<kStates>() = CrossOf(mode_index, covariance);
  for (const int index : shared_errors_.in_use()) {
    if (index < 0) continue;
    const int row = shared_errors_.Row(index);
    cov.block<kStates, 2>(0, row) = CrossOf(index, covariance);
    cross.middleRows<2>(row) = covariance.Block(index, mode_index);
    for (const int other : shared_errors_.in_use()) {
      if (other < 0) continue;
      cov.block<2, 2>(row, shared_errors_.Row(other)) = covariance.Block(index, other);
    }
  }
  cov.triangularView<Eigen::StrictlyLower>() = cov.transpose();
  const ByPoint on = cov.ldlt().solve(cross);
  SharedErrors::Regression regression;
  regression.on = on.transpose();
  regression.cov_rest =
      NonNegative(covariance.Block(mode_index, mode_index) - on.transpose() * cross);
  shared_errors_.Add(mode_index, regression);
}

// Other places, gains and the other bias are corrected by their regression on the state's error.
bool KnownMapFilter::AdoptSharedErrors(Observation::Kind kind, const JointCovariance& covariance) {
  const StateVector mean = shared_errors_.MeanOfState();
  const StateMatrix cov = shared_errors_.CovarianceOfState();
  if (!mean.allFinite() || !IsSoundCovariance(cov)) return false;
  const StateMatrix information = P_.inverse();
  const StateMatrix kept = cov * information;
  for (UnknownPlace& place : places_) {
    const int index = SharedErrors::PlaceIndex(place.group);
    if (shared_errors_.Has(index)) {
      const SharedErrors::PointError error = shared_errors_.ErrorOf(index);
      place.p_map_landmark = place.p_shared + error.mean;
      place.cov = error.cov;
      place.cross_state = error.cross_state;
      place.kind = kind;
      place.cross_bias = error.cross_bias;
    } else {
      const Eigen::Matrix<double, 2, kStates> regression =
          place.cross_state.transpose() * information;
      place.p_map_landmark += regression * mean;
      place.cov += regression * (cov - P_) * regression.transpose();
      place.cov = Symmetrized(place.cov);
      place.cross_state = (kept * place.cross_state).eval();
    }
  }
  ApplyGains();
  for (ConsideredMode& mode : considered_) mode.gain = (kept * mode.gain).eval();
  AdoptGains(covariance);
  for (SensorBias* bias : {&range_bearing_bias_, &position_bias_}) {
    bias->cross = (kept * bias->cross).eval();
  }
  SensorBias& seen = kind == Observation::Kind::kCartesian ? position_bias_ : range_bearing_bias_;
  seen.cross = shared_errors_.CrossOfBias();
  P_ = cov;
  const Eigen::Matrix3d A_pose = Move(mean, false).topLeftCorner<3, 3>();
  for (ConsideredMode& mode : considered_) MovePose(A_pose, &mode.gain);
  for (UnknownPlace& place : places_) MovePose(A_pose, &place.cross_state);
  StartAnewUnlessSound();
  return true;
}

// So that Σ gain · cov(mode, j) is the covariance of the state's error with that of each mode j in
// use there.
void KnownMapFilter::AdoptGains(const JointCovariance& covariance) {
  constexpr int kMax = 2 * SharedErrors::kMaxModes;
  using Square = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMax, kMax>;
  using ByState = Eigen::Matrix<double, Eigen::Dynamic, kStates, 0, kMax, kStates>;
  boost::container::static_vector<int, SharedErrors::kMaxModes> modes;
  for (const int index : shared_errors_.in_use()) {
    if (index >= 0) modes.push_back(index);
  }
  if (modes.empty()) return;
  for (ConsideredMode& mode : considered_) {
    if (std::find(modes.begin(), modes.end(), mode.index) != modes.end()) mode.gain.setZero();
  }
  const auto rows = static_cast<Eigen::Index>(2 * modes.size());
  Square prior(rows, rows);
  ByState cross(rows, kStates);
  for (Eigen::Index i = 0; i < rows; i += 2) {
    const int mode = modes[static_cast<std::size_t>(i / 2)];
    cross.middleRows<2>(i) =
        (shared_errors_.ErrorOf(mode).cross_state - CrossOf(mode, covariance)).transpose();
    for (Eigen::Index j = 0; j < rows; j += 2) {
      prior.block<2, 2>(i, j) = covariance.Block(mode, modes[static_cast<std::size_t>(j / 2)]);
    }
  }
  const ByState gains = prior.ldlt().solve(cross);
  for (Eigen::Index i = 0; i < rows; i += 2) {
    const int mode = modes[static_cast<std::size_t>(i / 2)];
    GainOf(mode) = gains.middleRows<2>(i).transpose();
    if (considered_modes() > kMaxConsideredModes) MarginalizeWeakest(mode);
  }
}

PoseWithCovariance KnownMapFilter::Pose() const {
  return {T_map_vehicle_, P_.topLeftCorner<3, 3>()};
}

}  // namespace shiftmap
