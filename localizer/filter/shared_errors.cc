// SPDX-License-Identifier: Apache-2.0
#include "localizer/filter/shared_errors.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

// A bias lasts for about as long: what a camera misjudges changes with the scene. [s]
constexpr double kBiasTime = 60.0;

}  // namespace

SharedErrors::SharedErrors(const StateMatrix& cov_state)
    : mean_(Vector::Zero(kFixed)), cov_(Matrix::Zero(kFixed, kFixed)) {
  cov_.topLeftCorner<kStates, kStates>() = cov_state;
}

template <int kColumns>
auto SharedErrors::CovarianceColumns(Eigen::Index first) const -> ColumnsOf<kColumns> {
  const Eigen::Index n = cov_.rows();
  ColumnsOf<kColumns> columns(n, kColumns);
  columns.topRows(first) = cov_.block(first, 0, kColumns, first).transpose();
  columns.bottomRows(n - first) = cov_.block(first, first, n - first, kColumns);
  for (Eigen::Index i = 0; i < kColumns; ++i) {
    for (Eigen::Index j = i + 1; j < kColumns; ++j) columns(first + i, j) = columns(first + j, i);
  }
  return columns;
}

template <int kColumns>
void SharedErrors::TransformPose(const Eigen::Matrix<double, 3, kColumns>& B) {
  mean_.head<3>() = (B * mean_.head<kColumns>()).eval();
  StateMatrix cov_state = cov_.topLeftCorner<kStates, kStates>().selfadjointView<Eigen::Lower>();
  cov_state.topRows<3>() = (B * cov_state.topRows<kColumns>()).eval();
  cov_state.leftCols<3>() = (cov_state.leftCols<kColumns>() * B.transpose()).eval();
  cov_.topLeftCorner<kStates, kStates>() = cov_state;
  const Eigen::Index others = cov_.rows() - kStates;
  const ColumnsOf<3> cross = cov_.bottomLeftCorner(others, kColumns).lazyProduct(B.transpose());
  cov_.bottomLeftCorner(others, 3) = cross;
}

void SharedErrors::Predict(const StateMatrix& F, const StateMatrix& noise, double elapsed_s) {
  TransformPose<kStates>(F.topRows<3>());
  cov_.topLeftCorner<kStates, kStates>() += noise;
  if (!has_bias_) return;
  const double keep = std::exp(-elapsed_s / kBiasTime);
  mean_.segment<2>(kBias) *= keep;
  cov_.block<2, kFixed>(kBias, 0) *= keep;
  cov_.block(kBias, kBias, cov_.rows() - kBias, 2) *= keep;
  cov_.block<2, 2>(kBias, kBias) += (1.0 - keep * keep) * cov_bias_;
}

void SharedErrors::Move(const StateMatrix& A, const StateVector& correction) {
  mean_.head<kStates>() -= correction;
  TransformPose<3>(A.topLeftCorner<3, 3>());
}

double SharedErrors::LogLikelihood(const Observed& observed,
                                   const JointCovariance& covariance) const {
  if (!has_bias_ || kind_ != observed.kind) {
    SharedErrors other = *this;
    other.UseBiasOf(observed);
    return other.LogLikelihood(observed, covariance);
  }
  const Expected expected = Expect(observed, ErrorOf(observed.mode_index, covariance));
  return LogGaussian(observed.nu - expected.nu, expected.S);
}

void SharedErrors::Update(const Observed& observed, const JointCovariance& covariance) {
  UseBiasOf(observed);
  if (Place(observed.mode_index) < 0) {
    if (modes_ == kMaxModes) RemoveOldest();
    Add(observed.mode_index, ErrorOfNew(observed.mode_index, covariance));
  }
  const int place = Place(observed.mode_index);
  last_used_[static_cast<std::size_t>((place - kFixed) / 2)] = ++uses_;
  const ModeError mode = ErrorOf(observed.mode_index, covariance);
  const Expected expected = Expect(observed, mode);
  const Columns cross = CrossWithInnovation(observed, mode);
  const Columns K = cross.lazyProduct(expected.S.inverse().eval());
  mean_ += K * (observed.nu - expected.nu);
  for (Eigen::Index i = 0; i < cov_.cols(); ++i) {
    const Eigen::Index rows = cov_.rows() - i;
    cov_.col(i).tail(rows) -= K.col(0).tail(rows) * cross(i, 0) + K.col(1).tail(rows) * cross(i, 1);
  }
}

int SharedErrors::Place(int mode_index) const {
  const auto end = mode_indices_.begin() + modes_;
  const auto found = std::find(mode_indices_.begin(), end, mode_index);
  return found == end ? -1 : kFixed + 2 * static_cast<int>(found - mode_indices_.begin());
}

SharedErrors::ModeError SharedErrors::ErrorOf(int mode_index,
                                              const JointCovariance& covariance) const {
  const int place = Place(mode_index);
  if (place < 0) return ErrorOfNew(mode_index, covariance);
  const Columns cross = CovarianceColumns<2>(place);
  return {mean_.segment<2>(place), cross.middleRows<2>(place), cross};
}

SharedErrors::ModeError SharedErrors::ErrorOfNew(int mode_index,
                                                 const JointCovariance& covariance) const {
  const Eigen::Matrix2d prior = covariance.Block(mode_index, mode_index);
  ModeError mode{Eigen::Vector2d::Zero(), prior, Columns::Zero(cov_.rows(), 2)};
  // Of the modes in use with the new one, and its regression on them.
  const Eigen::Index used = Eigen::Index{2} * modes_;
  Columns with_new(used, 2);
  for (int i = 0; i < modes_; ++i) {
    const int index = mode_indices_[static_cast<std::size_t>(i)];
    with_new.middleRows<2>(Eigen::Index{2} * i) = covariance.Block(index, mode_index);
  }
  if (with_new.isZero(0.0)) return mode;
  Matrix joint(used, used);
  for (int i = 0; i < modes_; ++i) {
    for (int j = 0; j < modes_; ++j) {
      joint.block<2, 2>(Eigen::Index{2} * i, Eigen::Index{2} * j) = covariance.Block(
          mode_indices_[static_cast<std::size_t>(i)], mode_indices_[static_cast<std::size_t>(j)]);
    }
  }
  const Columns regression = joint.llt().solve(with_new);
  mode.mean = regression.transpose() * mean_.tail(used);
  const Matrix cov = cov_.selfadjointView<Eigen::Lower>();
  mode.cross = cov.rightCols(used) * regression;
  mode.cov = prior - with_new.transpose() * regression +
             regression.transpose() * cov.bottomRightCorner(used, used) * regression;
  return mode;
}

SharedErrors::Expected SharedErrors::Expect(const Observed& observed, const ModeError& mode) const {
  Expected expected;
  expected.nu = observed.H_pose * mean_.head<3>() + observed.H_bias * mean_.segment<2>(kBias) +
                observed.H_mode * mode.mean;
  const Eigen::Matrix<double, kFixed, kFixed> cov =
      cov_.topLeftCorner<kFixed, kFixed>().selfadjointView<Eigen::Lower>();
  const Eigen::Matrix<double, kFixed, 2> cross =
      cov.leftCols<3>() * observed.H_pose.transpose() +
      cov.middleCols<2>(kBias) * observed.H_bias.transpose() +
      mode.cross.topRows<kFixed>() * observed.H_mode.transpose();
  const Eigen::Matrix2d cross_mode =
      mode.cross.topRows<3>().transpose() * observed.H_pose.transpose() +
      mode.cross.middleRows<2>(kBias).transpose() * observed.H_bias.transpose() +
      mode.cov * observed.H_mode.transpose();
  expected.S = Symmetrized(Eigen::Matrix2d(observed.H_pose * cross.topRows<3>() +
                                           observed.H_bias * cross.middleRows<2>(kBias) +
                                           observed.H_mode * cross_mode + observed.cov_noise));
  return expected;
}

SharedErrors::Columns SharedErrors::CrossWithInnovation(const Observed& observed,
                                                        const ModeError& mode) const {
  return CovarianceColumns<3>(0).lazyProduct(observed.H_pose.transpose()) +
         CovarianceColumns<2>(kBias).lazyProduct(observed.H_bias.transpose()) +
         mode.cross.lazyProduct(observed.H_mode.transpose());
}

void SharedErrors::Add(int mode_index, const ModeError& mode) {
  const auto n = cov_.rows();
  mean_.conservativeResize(n + 2);
  cov_.conservativeResize(n + 2, n + 2);
  mean_.tail<2>() = mode.mean;
  cov_.bottomLeftCorner(2, n) = mode.cross.transpose();
  cov_.bottomRightCorner<2, 2>() = mode.cov;
  mode_indices_[static_cast<std::size_t>(modes_)] = mode_index;
  last_used_[static_cast<std::size_t>(modes_)] = ++uses_;
  ++modes_;
}

void SharedErrors::RemoveOldest() {
  const auto oldest = std::min_element(last_used_.begin(), last_used_.begin() + modes_);
  const auto slot = oldest - last_used_.begin();
  const Eigen::Index row = kFixed + 2 * slot;
  const Eigen::Index n = cov_.rows();
  const Eigen::Index after = n - row - 2;
  mean_.segment(row, after) = mean_.tail(after).eval();
  cov_.middleRows(row, after) = Matrix(cov_.bottomRows(after));
  cov_.middleCols(row, after) = Matrix(cov_.rightCols(after));
  mean_.conservativeResize(n - 2);
  cov_.conservativeResize(n - 2, n - 2);
  std::copy(oldest + 1, last_used_.begin() + modes_, oldest);
  const auto index = mode_indices_.begin() + slot;
  std::copy(index + 1, mode_indices_.begin() + modes_, index);
  --modes_;
}

void SharedErrors::UseBiasOf(const Observed& observed) {
  if (has_bias_ && kind_ == observed.kind) return;
  has_bias_ = true;
  kind_ = observed.kind;
  cov_bias_ = observed.cov_bias;
  mean_.segment<2>(kBias).setZero();
  cov_.middleRows<2>(kBias).setZero();
  cov_.middleCols<2>(kBias).setZero();
  cov_.block<2, 2>(kBias, kBias) = cov_bias_;
}

}  // namespace shiftmap
