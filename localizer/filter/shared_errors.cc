// SPDX-License-Identifier: Apache-2.0
#include "localizer/filter/shared_errors.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>

#include "localizer/filter/well_conditioned.h"
#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

// A bias lasts for about as long: what a camera misjudges changes with the scene. [s]
constexpr double kBiasTime = 60.0;

using Pair = Eigen::Array2d;

// Of an unknown place, per axis. [m]
constexpr double kPlaceSd = 100.0;

// Of the errors of two modes or places before anything is seen.
Eigen::Matrix2d PriorOf(int a, int b, const JointCovariance& covariance) {
  if (a >= 0 && b >= 0) return covariance.Block(a, b);
  if (a != b) return Eigen::Matrix2d::Zero();
  return kPlaceSd * kPlaceSd * Eigen::Matrix2d::Identity();
}

// Two rows of a column, the first of them even.
Eigen::Map<Pair, Eigen::Aligned16> At(double* column, int row) {
  return Eigen::Map<Pair, Eigen::Aligned16>(column + row);
}
Eigen::Map<const Pair, Eigen::Aligned16> At(const double* column, int row) {
  return Eigen::Map<const Pair, Eigen::Aligned16>(column + row);
}

}  // namespace

SharedErrors::SharedErrors(const StateMatrix& cov_state) {
  for (int i = 0; i < kStates; ++i) {
    for (int j = 0; j < kStates; ++j) cov_(i, j) = cov_state(i, j);
  }
}

template <int kColumns>
void SharedErrors::TransformPose(const Eigen::Matrix<double, 3, kColumns>& B) {
  mean_.head<3>() = (B * mean_.head<kColumns>()).eval();
  StateMatrix cov_state;
  for (int j = 0; j < kStates; ++j) {
    for (int i = 0; i < kStates; ++i) cov_state(i, j) = cov_(i, j);
  }
  cov_state.topRows<3>() = (B * cov_state.topRows<kColumns>()).eval();
  cov_state.leftCols<3>() = (cov_state.leftCols<kColumns>() * B.transpose()).eval();
  double* columns[kColumns];
  for (int k = 0; k < kColumns; ++k) columns[k] = cov_.Column(k);
  for (int row = kStates; row < rows(); row += 2) {
    Pair sums[3];
    for (int i = 0; i < 3; ++i) {
      sums[i] = At(columns[0], row) * B(i, 0);
      for (int k = 1; k < kColumns; ++k) sums[i] += At(columns[k], row) * B(i, k);
    }
    for (int i = 0; i < 3; ++i) At(columns[i], row) = sums[i];
  }
  for (int j = 0; j < kStates; ++j) {
    for (int i = j; i < kStates; ++i) cov_(i, j) = cov_state(i, j);
  }
  cov_.MirrorFull();
}

void SharedErrors::Predict(const StateMatrix& F, const StateMatrix& noise, double elapsed_s) {
  TransformPose<kStates>(F.topRows<3>());
  for (int j = 0; j < kStates; ++j) {
    for (int i = 0; i < kStates; ++i) cov_(i, j) += noise(i, j);
  }
  if (!has_bias_) return;
  const double keep = std::exp(-elapsed_s / kBiasTime);
  mean_.segment<2>(kBias) *= keep;
  for (int i = kBias; i < kBias + 2; ++i) {
    for (int j = 0; j < kBias; ++j) cov_(i, j) *= keep;
    for (int j = kBias; j <= i; ++j) {
      const double cov_bias = cov_bias_(i - kBias, j - kBias);
      cov_(i, j) = cov_(i, j) * keep * keep + (1.0 - keep * keep) * cov_bias;
    }
    for (int row = kFixed; row < rows(); row += 2) At(cov_.Column(i), row) *= keep;
  }
  cov_.MirrorFull();
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
  const ModeError mode = ErrorOf(observed.mode_index, covariance, kFixed);
  const Expected expected = Expect(observed, mode, kFixed);
  if (!IsWellConditioned(expected.S)) return -std::numeric_limits<double>::infinity();
  return LogGaussian(observed.nu - expected.nu, expected.S);
}

bool SharedErrors::Update(const Observed& observed, const JointCovariance& covariance) {
  UseBiasOf(observed);
  int place = Row(observed.mode_index);
  if (place < 0) {
    MakeRoom();
    place = rows();
    Add(observed.mode_index, ErrorOfNew(observed.mode_index, covariance));
  }
  last_used_[static_cast<std::size_t>((place - kFixed) / 2)] = ++uses_;
  const ModeError mode = ErrorOf(observed.mode_index, covariance, rows());
  const Expected expected = Expect(observed, mode, rows());
  const Eigen::Vector2d surprise = observed.nu - expected.nu;
  if (!IsWellConditioned(expected.S) || !surprise.allFinite()) return false;
  const Eigen::Matrix2d information = expected.S.inverse();
  Columns K;
  for (int row = 0; row < rows(); row += 2) {
    const Pair cross_0 = At(expected.cross.col(0).data(), row);
    const Pair cross_1 = At(expected.cross.col(1).data(), row);
    const Pair K_0 = cross_0 * information(0, 0) + cross_1 * information(1, 0);
    const Pair K_1 = cross_0 * information(0, 1) + cross_1 * information(1, 1);
    At(K.col(0).data(), row) = K_0;
    At(K.col(1).data(), row) = K_1;
    At(mean_.data(), row) += K_0 * surprise.x() + K_1 * surprise.y();
  }
  Subtract(K, expected.cross);
  return true;
}

SharedErrors::StateMatrix SharedErrors::CovarianceOfState() const {
  StateMatrix cov;
  for (int j = 0; j < kStates; ++j) {
    for (int i = 0; i < kStates; ++i) cov(i, j) = cov_(i, j);
  }
  return cov;
}

SharedErrors::StateByPoint SharedErrors::CrossOfBias() const {
  StateByPoint cross;
  for (int j = 0; j < 2; ++j) {
    for (int i = 0; i < kStates; ++i) cross(i, j) = cov_(i, kBias + j);
  }
  return cross;
}

SharedErrors::PointError SharedErrors::ErrorOf(int mode_index) const {
  const int place = Row(mode_index);
  PointError error;
  error.mean = mean_.segment<2>(place);
  for (int j = 0; j < 2; ++j) {
    for (int i = 0; i < 2; ++i) {
      error.cov(i, j) = cov_(place + std::max(i, j), place + std::min(i, j));
      error.cross_bias(i, j) = cov_(place + j, kBias + i);
    }
    for (int i = 0; i < kStates; ++i) error.cross_state(i, j) = cov_(place + j, i);
  }
  return error;
}

void SharedErrors::Subtract(const Columns& K, const Columns& cross) {
  const double* const K_0 = K.col(0).data();
  const double* const K_1 = K.col(1).data();
  const int end = rows();
  for (int i = 0; i < end; i += 2) {
    double* const column = cov_.Column(i);
    double* const next = cov_.Column(i + 1);
    const double cross_00 = cross(i, 0);
    const double cross_01 = cross(i, 1);
    const double cross_10 = cross(i + 1, 0);
    const double cross_11 = cross(i + 1, 1);
    for (int row = i; row < end; row += 2) {
      const Pair k_0 = At(K_0, row);
      const Pair k_1 = At(K_1, row);
      At(column, row) -= k_0 * cross_00 + k_1 * cross_01;
      At(next, row) -= k_0 * cross_10 + k_1 * cross_11;
    }
  }
  cov_.MirrorFull();
}

int SharedErrors::Row(int mode_index) const {
  const auto end = mode_indices_.begin() + modes_;
  const auto found = std::find(mode_indices_.begin(), end, mode_index);
  return found == end ? -1 : kFixed + 2 * static_cast<int>(found - mode_indices_.begin());
}

SharedErrors::ModeError SharedErrors::ErrorOf(int mode_index,
                                              const JointCovariance& covariance,
                                              int rows) const {
  const int place = Row(mode_index);
  if (place < 0) return ErrorOfNew(mode_index, covariance);
  ModeError mode;
  mode.mean = mean_.segment<2>(place);
  const double* const first = cov_.Column(place);
  const double* const second = cov_.Column(place + 1);
  mode.cov << first[place], first[place + 1], first[place + 1], second[place + 1];
  for (int row = 0; row < std::min(rows, place); ++row) {
    mode.cross.row(row) = At(cov_.Column(row), place).matrix();
  }
  if (place >= rows) return mode;
  mode.cross.middleRows<2>(place) = mode.cov;
  for (int row = place + 2; row < rows; row += 2) {
    At(mode.cross.col(0).data(), row) = At(first, row);
    At(mode.cross.col(1).data(), row) = At(second, row);
  }
  return mode;
}

SharedErrors::ModeError SharedErrors::ErrorOfNew(int mode_index,
                                                 const JointCovariance& covariance) const {
  const Eigen::Matrix2d prior = PriorOf(mode_index, mode_index, covariance);
  ModeError mode{Eigen::Vector2d::Zero(), prior, Columns::Zero()};
  if (mode_index < 0 || covariance.cross_blocks().empty()) return mode;
  // Of the modes in use with the new one, and its regression on them.
  using Used = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 2 * kMaxModes, kMaxRows>;
  const Eigen::Index used = Eigen::Index{2} * modes_;
  Eigen::Matrix<double, Eigen::Dynamic, 2, 0, 2 * kMaxModes, 2> with_new(used, 2);
  for (int i = 0; i < modes_; ++i) {
    const int index = mode_indices_[static_cast<std::size_t>(i)];
    with_new.middleRows<2>(Eigen::Index{2} * i) = PriorOf(index, mode_index, covariance);
  }
  if (with_new.isZero(0.0)) return mode;
  Used joint(used, used);
  for (int i = 0; i < modes_; ++i) {
    for (int j = 0; j < modes_; ++j) {
      joint.block<2, 2>(Eigen::Index{2} * i, Eigen::Index{2} * j) =
          PriorOf(mode_indices_[static_cast<std::size_t>(i)],
                  mode_indices_[static_cast<std::size_t>(j)],
                  covariance);
    }
  }
  const Eigen::Matrix<double, Eigen::Dynamic, 2, 0, 2 * kMaxModes, 2> regression =
      joint.llt().solve(with_new);
  // Of the modes in use with a.
  Used cov(used, rows());
  for (int column = 0; column < rows(); ++column) {
    for (int row = kFixed; row < rows(); ++row) {
      cov(row - kFixed, column) = row >= column ? cov_(row, column) : cov_(column, row);
    }
  }
  mode.mean = regression.transpose() * mean_.segment(kFixed, used);
  mode.cross.topRows(rows()) = cov.transpose() * regression;
  mode.cov = prior - with_new.transpose() * regression +
             regression.transpose() * mode.cross.middleRows(kFixed, used);
  return mode;
}

SharedErrors::Expected SharedErrors::Expect(const Observed& observed,
                                            const ModeError& mode,
                                            int rows) const {
  const Eigen::Matrix<double, 2, 3>& H_pose = observed.H_pose;
  const Eigen::Matrix2d& H_bias = observed.H_bias;
  const Eigen::Matrix2d& H_mode = observed.H_mode;
  Expected expected;
  const Eigen::Vector2d& H_scale = observed.H_range_scale;
  expected.nu = H_pose * mean_.head<3>() + H_scale * mean_(kRangeScale) +
                H_bias * mean_.segment<2>(kBias) + H_mode * mode.mean;
  for (int row = 0; row < rows; row += 2) {
    const Pair x = At(cov_.Column(0), row);
    const Pair y = At(cov_.Column(1), row);
    const Pair yaw = At(cov_.Column(2), row);
    const Pair scale = At(cov_.Column(kRangeScale), row);
    const Pair bias_0 = At(cov_.Column(kBias), row);
    const Pair bias_1 = At(cov_.Column(kBias + 1), row);
    const Pair mode_0 = At(mode.cross.col(0).data(), row);
    const Pair mode_1 = At(mode.cross.col(1).data(), row);
    for (int i = 0; i < 2; ++i) {
      At(expected.cross.col(i).data(), row) =
          (x * H_pose(i, 0) + y * H_pose(i, 1) + yaw * H_pose(i, 2)) + scale * H_scale(i) +
          (bias_0 * H_bias(i, 0) + bias_1 * H_bias(i, 1)) +
          (mode_0 * H_mode(i, 0) + mode_1 * H_mode(i, 1));
    }
  }
  const Eigen::Matrix2d cross_mode =
      mode.cross.topRows<3>().transpose() * H_pose.transpose() +
      mode.cross.row(kRangeScale).transpose() * H_scale.transpose() +
      mode.cross.middleRows<2>(kBias).transpose() * H_bias.transpose() +
      mode.cov * H_mode.transpose();
  expected.S = Symmetrized(Eigen::Matrix2d(
      H_pose * expected.cross.topRows<3>() + H_scale * expected.cross.row(kRangeScale) +
      H_bias * expected.cross.middleRows<2>(kBias) + H_mode * cross_mode + observed.cov_noise));
  return expected;
}

void SharedErrors::Add(int mode_index, const ModeError& mode) {
  const int place = rows();
  mean_.segment<2>(place) = mode.mean;
  for (int row = 0; row < place; ++row) {
    At(cov_.Column(row), place) = mode.cross.row(row).transpose().array();
  }
  At(cov_.Column(place), place) = mode.cov.col(0).array();
  At(cov_.Column(place + 1), place) = mode.cov.col(1).array();
  mode_indices_[static_cast<std::size_t>(modes_)] = mode_index;
  last_used_[static_cast<std::size_t>(modes_)] = ++uses_;
  ++modes_;
}

void SharedErrors::Add(int mode_index, const Regression& regression) {
  const int end = rows();
  ModeError point{regression.on * mean_.head(end), regression.cov_rest, Columns::Zero()};
  for (int row = 0; row < end; ++row) {
    for (int i = 0; i < end; ++i) {
      const double cov = row >= i ? cov_(row, i) : cov_(i, row);
      point.cross.row(row) += cov * regression.on.col(i).transpose();
    }
  }
  point.cov += regression.on * point.cross.topRows(end);
  Add(mode_index, point);
}

void SharedErrors::MakeRoom() {
  if (modes_ == kMaxModes) RemoveOldest();
}

void SharedErrors::RemoveOldest() {
  const auto oldest = std::min_element(last_used_.begin(), last_used_.begin() + modes_);
  Remove(static_cast<std::size_t>(oldest - last_used_.begin()));
}

void SharedErrors::Forget(int mode_index) {
  const int row = Row(mode_index);
  if (row >= 0) Remove(static_cast<std::size_t>((row - kFixed) / 2));
}

// The last takes its rows.
void SharedErrors::Remove(std::size_t slot) {
  --modes_;
  const auto last_slot = static_cast<std::size_t>(modes_);
  if (slot == last_slot) return;
  const int place = kFixed + 2 * static_cast<int>(slot);
  const int last = rows();
  mean_.segment<2>(place) = mean_.segment<2>(last);
  for (int row = 0; row < place; ++row) {
    At(cov_.Column(row), place) = At(cov_.Column(row), last);
  }
  for (int column = 0; column < 2; ++column) {
    double* const freed = cov_.Column(place + column);
    At(freed, place) = At(cov_.Column(last + column), last);
    for (int row = place + 2; row < last; ++row) freed[row] = cov_(last + column, row);
  }
  mode_indices_[slot] = mode_indices_[last_slot];
  last_used_[slot] = last_used_[last_slot];
}

void SharedErrors::UseBiasOf(const Observed& observed) {
  if (HasBias(observed.kind)) return;
  has_bias_ = true;
  kind_ = observed.kind;
  cov_bias_ = observed.cov_bias;
  const Eigen::Matrix<double, 2, kStates>& on_state = observed.bias_on_state;
  const Eigen::Matrix<double, 2, kStates> with_state = on_state * CovarianceOfState();
  const Eigen::Matrix2d cov =
      observed.cov_bias_rest.value_or(observed.cov_bias) + with_state * on_state.transpose();
  mean_.segment<2>(kBias) = on_state * mean_.head<kStates>();
  for (int i = 0; i < 2; ++i) {
    for (int j = 0; j < kStates; ++j) cov_(kBias + i, j) = with_state(i, j);
    for (int j = 0; j <= i; ++j) cov_(kBias + i, kBias + j) = cov(i, j);
    for (int row = kFixed; row < rows(); ++row) {
      double with_row = 0.0;
      for (int j = 0; j < kStates; ++j) with_row += on_state(i, j) * cov_(row, j);
      cov_(row, kBias + i) = with_row;
    }
  }
  cov_.MirrorFull();
}

}  // namespace shiftmap
