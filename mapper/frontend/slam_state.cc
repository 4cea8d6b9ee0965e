// SPDX-License-Identifier: Apache-2.0
#include "mapper/frontend/slam_state.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <cmath>
#include <utility>

#include "mapstore/geometry/covariance.h"
#include "proto/core/check.h"

namespace shiftmap {
namespace {

constexpr int kVehicle = 5;  // Pose (x, y, yaw) and (log scale_v, log scale_omega).

// How far the vehicle drives on one active set. A larger one changes less often, and each step
// costs more. [m]
constexpr double kMargin = 20.0;

// So few landmarks are active all the time: changing the set would cost more than it saves.
constexpr std::size_t kAlwaysActive = 30;

// Two landmarks that are taken for one still differ by this, which keeps the covariance positive.
// [m]
constexpr double kFuseSd = 1e-3;

// J v: a quarter turn.
Eigen::Vector2d Turned(const Eigen::Vector2d& v) { return {-v.y(), v.x()}; }

void RemoveRows(Eigen::Index at, Eigen::MatrixXd* matrix) {
  const Eigen::Index below = matrix->rows() - at - 2;
  matrix->middleRows(at, below) = matrix->bottomRows(below).eval();
  matrix->conservativeResize(matrix->rows() - 2, Eigen::NoChange);
}

void RemoveColumns(Eigen::Index at, Eigen::MatrixXd* matrix) {
  const Eigen::Index right = matrix->cols() - at - 2;
  matrix->middleCols(at, right) = matrix->rightCols(right).eval();
  matrix->conservativeResize(Eigen::NoChange, matrix->cols() - 2);
}

}  // namespace

SlamState::SlamState(const Calibration& calibration, Errors errors)
    : calibration_(calibration), errors_(errors) {
  covariance_ = Eigen::MatrixXd::Zero(kVehicle, kVehicle);
  const double sd = calibration.odometry.sd_log_scale;
  covariance_(3, 3) = covariance_(4, 4) = sd * sd;
  cross_.resize(kVehicle, 0);
  passive_covariance_.resize(0, 0);
  BeginGathering();
}

int SlamState::AddKnown(std::span<const Eigen::Vector2d> positions, const Eigen::MatrixXd& cov) {
  SHIFTMAP_CHECK(passive_.empty(), "{} landmarks are passive", passive_.size());
  const auto first = static_cast<int>(landmarks_.size());
  const Eigen::Index before = covariance_.rows();
  const Eigen::Index size = before + cov.rows();
  covariance_.conservativeResize(size, size);
  covariance_.bottomRows(cov.rows()).setZero();
  covariance_.rightCols(cov.rows()).setZero();
  covariance_.bottomRightCorner(cov.rows(), cov.rows()) = cov;
  for (const Eigen::Vector2d& position : positions) {
    active_.push_back(static_cast<int>(landmarks_.size()));
    landmarks_.push_back({position, static_cast<int>(active_.size()) - 1, -1});
  }
  cross_.resize(size, 0);
  BeginGathering();
  return first;
}

void SlamState::StartFrom(const PoseWithCovariance& pose, const Calibration& calibration) {
  calibration_ = calibration;
  focus_radius_ = -1.0;
  pose_ = pose.T_map_vehicle;
  log_scale_.setZero();
  covariance_.topRows<kVehicle>().setZero();
  covariance_.leftCols<kVehicle>().setZero();
  phi_.topRows<kVehicle>().setZero();
  covariance_.topLeftCorner<3, 3>() = pose.cov_T_map_vehicle;
  const double sd = calibration_.odometry.sd_log_scale;
  covariance_(3, 3) = covariance_(4, 4) = sd * sd;
}

void SlamState::TieStartTo(const std::vector<int>& landmarks) {
  constexpr double kMinSpread = 1.0;  // Of the landmarks about their mean, summed. [m²]
  Eigen::Matrix3d N = Eigen::Matrix3d::Zero();
  Eigen::MatrixXd A(3, 2 * landmarks.size());
  std::vector<Eigen::Index> rows;
  for (const int landmark : landmarks) {
    const Eigen::Vector2d q = pose_.Inverse() * At(landmark).position;
    Eigen::Matrix<double, 2, 3> H;  // Its motion in the vehicle frame with all of them.
    H << 1.0, 0.0, -q.y(), 0.0, 1.0, q.x();
    N += H.transpose() * H;
    A.middleCols<2>(static_cast<Eigen::Index>(rows.size())) =
        H.transpose() * pose_.Rotation().transpose();
    for (const int axis : {0, 1}) rows.push_back(Offset(landmark) + axis);
  }
  const auto count = static_cast<double>(landmarks.size());
  if (landmarks.size() < 2 || N.determinant() < kMinSpread * count * count) return;
  A = N.ldlt().solve(A).eval();
  const Eigen::MatrixXd cross = A * covariance_(rows, Eigen::all);
  covariance_.topLeftCorner<3, 3>() += A * covariance_(rows, rows) * A.transpose();
  covariance_.topRows<3>() += cross;
  covariance_.leftCols<3>() += cross.transpose();
  phi_.topRows<3>() = A * phi_(rows, Eigen::all);
}

OdometryCalibration SlamState::Odometry() const {
  OdometryCalibration odometry = calibration_.odometry;
  odometry.scale_v *= std::exp(log_scale_.x());
  odometry.scale_omega *= std::exp(log_scale_.y());
  return odometry;
}

int SlamState::Offset(int landmark) const {
  const int index = At(landmark).active;
  SHIFTMAP_CHECK(index >= 0, "landmark {} is not active", landmark);
  return kVehicle + 2 * index;
}

Eigen::Matrix2d SlamState::PositionCovariance(int landmark) const {
  const int o = Offset(landmark);
  return covariance_.block<2, 2>(o, o);
}

Eigen::Matrix2d SlamState::DifferenceCovariance(int a, int b) const {
  const int i = Offset(a);
  const int j = Offset(b);
  return covariance_.block<2, 2>(i, i) + covariance_.block<2, 2>(j, j) -
         covariance_.block<2, 2>(i, j) - covariance_.block<2, 2>(j, i);
}

Eigen::MatrixXd SlamState::LandmarkCovariance(const std::vector<int>& landmarks) const {
  std::vector<Eigen::Index> rows;
  for (const int landmark : landmarks) {
    rows.push_back(Offset(landmark));
    rows.push_back(Offset(landmark) + 1);
  }
  return covariance_(rows, rows);
}

Eigen::MatrixXd SlamState::PoseAndLandmarkCovariance() const {
  std::vector<Eigen::Index> rows = {0, 1, 2};
  for (Eigen::Index i = kVehicle; i < covariance_.rows(); ++i) rows.push_back(i);
  return covariance_(rows, rows);
}

SlamState::Relative SlamState::RelativeTo(int landmark) const {
  const int o = Offset(landmark);
  const Eigen::Vector2d q = pose_.Inverse() * At(landmark).position;
  Eigen::Matrix<double, 2, 3> H;
  H << -1.0, 0.0, q.y(), 0.0, -1.0, -q.x();
  const Eigen::Matrix2d R = pose_.Rotation().transpose();
  const Eigen::Matrix2d cross = H * covariance_.block<3, 2>(0, o) * R.transpose();
  const Eigen::Matrix2d cov = H * covariance_.topLeftCorner<3, 3>() * H.transpose() + cross +
                              cross.transpose() + R * covariance_.block<2, 2>(o, o) * R.transpose();
  return {q, Symmetrized(cov)};
}

void SlamState::Predict(const MotionIncrement& motion) {
  pose_ = pose_ * motion.T_begin_end;
  Eigen::Matrix<double, kVehicle, kVehicle> F =
      Eigen::Matrix<double, kVehicle, kVehicle>::Identity();
  F.topLeftCorner<3, 3>() = motion.T_begin_end.InverseAdjoint();
  F.topRightCorner<3, 2>() = motion.J_calibration.leftCols<2>();
  covariance_.topRows<kVehicle>() = (F * covariance_.topRows<kVehicle>()).eval();
  covariance_.leftCols<kVehicle>() = (covariance_.leftCols<kVehicle>() * F.transpose()).eval();
  covariance_.topLeftCorner<3, 3>() += motion.cov;
  phi_.topRows<kVehicle>() = (F * phi_.topRows<kVehicle>()).eval();
}

int SlamState::Add(const Observation& observation) {
  const auto landmark = static_cast<int>(landmarks_.size());
  landmarks_.push_back({.active = static_cast<int>(active_.size())});
  active_.push_back(landmark);
  const Eigen::Index size = covariance_.rows() + 2;
  covariance_.conservativeResize(size, size);
  phi_.conservativeResize(size, Eigen::NoChange);
  Initialize(landmark, observation);
  return landmark;
}

void SlamState::Place(int landmark, const Observation& observation) {
  Activate(landmark);
  Initialize(landmark, observation);
}

// p = T q with q as observed: everything a new landmark correlates with, it does through the pose.
void SlamState::Initialize(int landmark, const Observation& observation) {
  const Eigen::Vector2d q = observation.PositionInVehicle();
  const Eigen::Matrix2d R = pose_.Rotation();
  At(landmark).position = pose_ * q;
  Eigen::Matrix<double, 2, 3> G;
  G << 1.0, 0.0, -q.y(), 0.0, 1.0, q.x();
  G = (R * G).eval();
  const int o = Offset(landmark);
  covariance_.middleRows(o, 2).setZero();
  covariance_.middleCols(o, 2).setZero();
  const Eigen::MatrixXd rows = G * covariance_.topRows<3>();
  covariance_.middleRows(o, 2) = rows;
  covariance_.middleCols(o, 2) = rows.transpose();
  const Eigen::Matrix2d noise =
      PositionNoiseInVehicle(observation, ObservationNoise(observation, calibration_.sensor));
  covariance_.block<2, 2>(o, o) =
      G * covariance_.topLeftCorner<3, 3>() * G.transpose() + R * noise * R.transpose();
  phi_.middleRows(o, 2) = G * phi_.topRows<3>();
}

void SlamState::RemoveActive(int index) {
  const Eigen::Index o = kVehicle + 2 * index;
  RemoveRows(o, &covariance_);
  RemoveColumns(o, &covariance_);
  RemoveRows(o, &phi_);
  active_.erase(active_.begin() + index);
  for (std::size_t i = static_cast<std::size_t>(index); i < active_.size(); ++i) {
    At(active_[i]).active = static_cast<int>(i);
  }
}

void SlamState::Remove(int landmark) {
  Landmark& removed = At(landmark);
  if (removed.active >= 0) RemoveActive(removed.active);
  if (removed.passive >= 0) {
    const Eigen::Index o = Eigen::Index{2} * removed.passive;
    RemoveColumns(o, &cross_);
    RemoveRows(o, &passive_covariance_);
    RemoveColumns(o, &passive_covariance_);
    passive_.erase(passive_.begin() + removed.passive);
    for (std::size_t i = static_cast<std::size_t>(removed.passive); i < passive_.size(); ++i) {
      At(passive_[i]).passive = static_cast<int>(i);
    }
  }
  removed.active = removed.passive = -1;
}

void SlamState::BeginGathering() {
  // Without passive landmarks there is nothing to gather for.
  const Eigen::Index gathered = passive_.empty() ? 0 : covariance_.rows();
  phi_ = Eigen::MatrixXd::Identity(covariance_.rows(), gathered);
  psi_ = Eigen::MatrixXd::Zero(gathered, gathered);
  theta_ = Eigen::VectorXd::Zero(gathered);
}

void SlamState::Settle() {
  if (!passive_.empty()) {
    const Eigen::VectorXd step = cross_.transpose() * theta_;
    for (std::size_t i = 0; i < passive_.size(); ++i) {
      At(passive_[i]).position += step.segment<2>(static_cast<Eigen::Index>(2 * i));
    }
    passive_covariance_.triangularView<Eigen::Lower>() -=
        cross_.transpose() * (psi_ * cross_).eval();
    passive_covariance_.triangularView<Eigen::StrictlyUpper>() = passive_covariance_.transpose();
    cross_ = (phi_ * cross_).eval();
    if (errors_ == Errors::kInvariant) TransportPassive(step);
  } else {
    cross_.resize(covariance_.rows(), 0);
  }
  BeginGathering();
}

void SlamState::TransportPassive(const Eigen::VectorXd& step) {
  Eigen::VectorXd by_turn(step.size());
  for (Eigen::Index o = 0; o < step.size(); o += 2) {
    by_turn.segment<2>(o) = Turned(step.segment<2>(o));
  }
  const Eigen::RowVectorXd yaw = cross_.row(2);
  passive_covariance_ += by_turn * yaw + yaw.transpose() * by_turn.transpose() +
                         covariance_(2, 2) * by_turn * by_turn.transpose();
  cross_ += covariance_.col(2) * by_turn.transpose();
}

void SlamState::SetActive(const std::vector<int>& landmarks) {
  const Eigen::Index a = covariance_.rows();
  const Eigen::Index b = passive_covariance_.rows();
  Eigen::MatrixXd all(a + b, a + b);
  all.topLeftCorner(a, a) = covariance_;
  all.topRightCorner(a, b) = cross_;
  all.bottomLeftCorner(b, a) = cross_.transpose();
  all.bottomRightCorner(b, b) = passive_covariance_;

  std::vector<Eigen::Index> order;  // Row in `all` of each state in its new place.
  for (Eigen::Index i = 0; i < kVehicle; ++i) order.push_back(i);
  const auto row_of = [&](const Landmark& landmark) {
    return landmark.active >= 0 ? kVehicle + 2 * Eigen::Index{landmark.active}
                                : a + 2 * Eigen::Index{landmark.passive};
  };
  std::vector<bool> chosen(landmarks_.size());
  for (const int landmark : landmarks) chosen[static_cast<std::size_t>(landmark)] = true;
  std::vector<int> passive;
  for (std::size_t i = 0; i < landmarks_.size(); ++i) {
    const bool removed = landmarks_[i].active < 0 && landmarks_[i].passive < 0;
    if (!chosen[i] && !removed) passive.push_back(static_cast<int>(i));
  }
  for (const std::vector<int>* part : {&landmarks, &std::as_const(passive)}) {
    for (const int landmark : *part) {
      order.push_back(row_of(At(landmark)));
      order.push_back(row_of(At(landmark)) + 1);
    }
  }
  active_ = landmarks;
  passive_ = std::move(passive);
  for (std::size_t i = 0; i < active_.size(); ++i) {
    At(active_[i]) = {At(active_[i]).position, static_cast<int>(i), -1};
  }
  for (std::size_t i = 0; i < passive_.size(); ++i) {
    At(passive_[i]) = {At(passive_[i]).position, -1, static_cast<int>(i)};
  }
  const auto size = static_cast<Eigen::Index>(kVehicle + 2 * active_.size());
  const std::vector<Eigen::Index> first(order.begin(), order.begin() + size);
  const std::vector<Eigen::Index> rest(order.begin() + size, order.end());
  covariance_ = all(first, first);
  cross_ = all(first, rest);
  passive_covariance_ = all(rest, rest);
  BeginGathering();
}

void SlamState::Focus(double reach_m) {
  if (passive_.empty() && active_.size() <= kAlwaysActive) return;
  const Eigen::Vector2d centre = pose_.translation();
  if (focus_radius_ >= 0.0 && (centre - focus_centre_).norm() + reach_m <= focus_radius_) return;
  Settle();
  focus_centre_ = centre;
  focus_radius_ = reach_m + kMargin;
  std::vector<int> near;
  for (std::size_t i = 0; i < landmarks_.size(); ++i) {
    const Landmark& landmark = landmarks_[i];
    if (landmark.active < 0 && landmark.passive < 0) continue;
    if ((landmark.position - centre).norm() <= focus_radius_) near.push_back(static_cast<int>(i));
  }
  SetActive(near);
}

void SlamState::Activate(int landmark) {
  if (At(landmark).active >= 0) return;
  std::vector<int> landmarks = active_;
  landmarks.push_back(landmark);
  Settle();
  SetActive(landmarks);
}

Innovation SlamState::Linearized(const SlamPair& pair, Eigen::Matrix2d* S) const {
  const int o = Offset(pair.landmark);
  const Innovation innovation = Linearize(*pair.observation, pose_, At(pair.landmark).position);
  const Eigen::Matrix2d cross =
      innovation.H_pose * covariance_.block<3, 2>(0, o) * innovation.H_landmark.transpose();
  *S = innovation.H_pose * covariance_.topLeftCorner<3, 3>() * innovation.H_pose.transpose() +
       cross + cross.transpose() +
       innovation.H_landmark * covariance_.block<2, 2>(o, o) * innovation.H_landmark.transpose() +
       ObservationNoise(*pair.observation, calibration_.sensor);
  *S = Symmetrized(*S);
  return innovation;
}

JointInnovation SlamState::Innovate(std::span<const SlamPair> pairs) const {
  const auto rows = static_cast<Eigen::Index>(2 * pairs.size());
  JointInnovation joint{Eigen::VectorXd(rows),
                        Eigen::MatrixXd(rows, rows),
                        Eigen::MatrixXd(covariance_.rows(), rows),
                        {}};
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const int o = Offset(pairs[i].landmark);
    const Innovation innovation =
        Linearize(*pairs[i].observation, pose_, At(pairs[i].landmark).position);
    const auto at = static_cast<Eigen::Index>(2 * i);
    joint.nu.segment<2>(at) = innovation.nu;
    joint.PHt.middleCols<2>(at) = covariance_.leftCols<3>() * innovation.H_pose.transpose() +
                                  covariance_.middleCols<2>(o) * innovation.H_landmark.transpose();
    joint.pairs.push_back(innovation);
  }
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const int o = Offset(pairs[i].landmark);
    const auto at = static_cast<Eigen::Index>(2 * i);
    joint.S.middleRows<2>(at) = joint.pairs[i].H_pose * joint.PHt.topRows<3>() +
                                joint.pairs[i].H_landmark * joint.PHt.middleRows<2>(o);
    joint.S.block<2, 2>(at, at) += ObservationNoise(*pairs[i].observation, calibration_.sensor);
  }
  joint.S = Symmetrized(joint.S);
  return joint;
}

JointInnovation SlamState::Update(std::span<const SlamPair> pairs) {
  JointInnovation joint = Innovate(pairs);
  if (pairs.empty()) return joint;
  Eigen::MatrixXd HPhi(joint.nu.size(), phi_.cols());
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const int o = Offset(pairs[i].landmark);
    const Innovation& innovation = joint.pairs[i];
    HPhi.middleRows<2>(static_cast<Eigen::Index>(2 * i)) =
        innovation.H_pose * phi_.topRows<3>() + innovation.H_landmark * phi_.middleRows<2>(o);
  }
  Correct(joint.nu, joint.S, joint.PHt, HPhi);
  return joint;
}

void SlamState::Correct(const Eigen::VectorXd& nu,
                        const Eigen::MatrixXd& S,
                        const Eigen::MatrixXd& PHt,
                        const Eigen::MatrixXd& HPhi) {
  const Eigen::LLT<Eigen::MatrixXd> llt(S);
  if (llt.info() != Eigen::Success) return;  // S has lost its digits.
  // P Hᵀ S⁻¹ H P = W Wᵀ.
  const Eigen::MatrixXd W = llt.matrixL().solve(PHt.transpose()).transpose();
  const Eigen::VectorXd whitened = llt.matrixL().solve(nu);
  const Eigen::VectorXd step = W * whitened;
  const Se2 pose_before = pose_;
  pose_ = pose_ * Se2::Exp(step.head<3>());
  log_scale_ += step.segment<2>(3);
  for (std::size_t i = 0; i < active_.size(); ++i) {
    At(active_[i]).position += step.segment<2>(kVehicle + static_cast<Eigen::Index>(2 * i));
  }
  covariance_.selfadjointView<Eigen::Lower>().rankUpdate(W, -1.0);
  covariance_.triangularView<Eigen::StrictlyUpper>() = covariance_.transpose();
  if (phi_.cols() > 0) {
    const Eigen::MatrixXd V = llt.matrixL().solve(HPhi);
    phi_.noalias() -= W * V;
    psi_.selfadjointView<Eigen::Lower>().rankUpdate(V.transpose(), 1.0);
    psi_.triangularView<Eigen::StrictlyUpper>() = psi_.transpose();
    theta_.noalias() += V.transpose() * whitened;
  }
  if (errors_ == Errors::kInvariant) Transport(pose_before, step);
}

// With the turn θ of the whole about the origin taken out of it, an error is e_p - J p θ of a
// landmark at p, and R ρ - J t θ of a pose (R, t) with the error (ρ, θ) in its own frame. These
// stay as they are when the estimate moves:
//
//   e_p' = e_p + J Δp θ,   ρ' = R'ᵀ (R ρ + J Δt θ),   θ' = θ.
//
// Landmarks that are not active move at the next Settle(), and their errors with them.
void SlamState::Transport(const Se2& pose_before, const Eigen::VectorXd& step) {
  const Eigen::Matrix2d back = pose_.Rotation().transpose();
  const Eigen::Matrix2d R = back * pose_before.Rotation();
  Eigen::VectorXd by_turn = Eigen::VectorXd::Zero(covariance_.rows());
  by_turn.head<2>() = back * Turned(pose_.translation() - pose_before.translation());
  for (Eigen::Index o = kVehicle; o < by_turn.size(); o += 2) {
    by_turn.segment<2>(o) = Turned(step.segment<2>(o));
  }
  const auto transport_rows = [&](Eigen::MatrixXd* rows) {
    rows->topRows<2>() = (R * rows->topRows<2>()).eval();
    const Eigen::RowVectorXd yaw = rows->row(2);
    rows->noalias() += by_turn * yaw;
  };
  transport_rows(&covariance_);
  covariance_.transposeInPlace();
  transport_rows(&covariance_);
  covariance_ = Symmetrized(covariance_);
  transport_rows(&phi_);
}

void SlamState::Fuse(int a, int b) {
  const int i = Offset(a);
  const int j = Offset(b);
  const Eigen::MatrixXd PHt = covariance_.middleCols<2>(i) - covariance_.middleCols<2>(j);
  const Eigen::Matrix2d S =
      DifferenceCovariance(a, b) + Eigen::Matrix2d::Identity() * kFuseSd * kFuseSd;
  const Eigen::MatrixXd HPhi = phi_.middleRows<2>(i) - phi_.middleRows<2>(j);
  Correct(At(b).position - At(a).position, Symmetrized(S), PHt, HPhi);
  Remove(b);
}

bool SlamState::HasLandmarksOf(const SlamState& other) const {
  if (landmarks_.size() != other.landmarks_.size()) return false;
  for (std::size_t i = 0; i < landmarks_.size(); ++i) {
    const auto removed = [](const Landmark& l) { return l.active < 0 && l.passive < 0; };
    if (removed(landmarks_[i]) != removed(other.landmarks_[i])) return false;
  }
  return true;
}

Eigen::VectorXd SlamState::StepTo(const SlamState& other) const {
  Eigen::VectorXd step(covariance_.rows());
  step.head<3>() = (pose_.Inverse() * other.pose_).Log();
  step.segment<2>(3) = other.log_scale_ - log_scale_;
  for (std::size_t i = 0; i < active_.size(); ++i) {
    step.segment<2>(kVehicle + static_cast<Eigen::Index>(2 * i)) =
        other.At(active_[i]).position - At(active_[i]).position;
  }
  return step;
}

double SlamState::SquaredDistanceTo(const SlamState& other) const {
  SHIFTMAP_CHECK(active_ == other.active_, "other landmarks are active");
  const Eigen::VectorXd step = StepTo(other);
  Eigen::MatrixXd sum = covariance_ + other.covariance_;
  // What neither is uncertain of, the scales of known odometry or a first pose, has no variance.
  sum.diagonal().array() += kFuseSd * kFuseSd;
  return step.dot(sum.selfadjointView<Eigen::Lower>().llt().solve(step));
}

void SlamState::MixWith(SlamState other, double share) {
  for (SlamState* state : {this, &other}) {
    state->Settle();
    std::vector<int> all;
    for (std::size_t i = 0; i < state->landmarks_.size(); ++i) {
      const Landmark& landmark = state->landmarks_[i];
      if (landmark.active >= 0 || landmark.passive >= 0) all.push_back(static_cast<int>(i));
    }
    state->SetActive(all);
  }
  focus_radius_ = -1.0;
  const Eigen::VectorXd step = StepTo(other);
  covariance_ = (1.0 - share) * covariance_ + share * other.covariance_ +
                share * (1.0 - share) * step * step.transpose();
  pose_ = pose_ * Se2::Exp(share * step.head<3>());
  log_scale_ += share * step.segment<2>(3);
  for (std::size_t i = 0; i < active_.size(); ++i) {
    At(active_[i]).position += share * step.segment<2>(kVehicle + static_cast<Eigen::Index>(2 * i));
  }
}

}  // namespace shiftmap
