// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/rest_system.h"

#include <algorithm>
#include <numeric>
#include <utility>

#include "proto/core/check.h"

namespace shiftmap {
namespace {

// Up to here a dense factor is faster than ordering a sparse one.
constexpr int kMaxDense = 400;

// Conjugate gradients: relative error of the solution in the norm of the factor, and how many
// iterations cost less than a factor.
constexpr double kTolerance = 1e-6;
constexpr int kMaxIterations = 8;

// The same of steps and draws beside a border: of the way down a step leaves the square of it,
// which is less than the loss' weights change by, and draws scatter by more.
constexpr double kBorderedTolerance = 1e-2;

// The same of other right sides beside a border.
constexpr double kExactTolerance = 1e-4;

// Slower than this, per iteration in the squared norm, they do not get there.
constexpr double kLeastProgress = 0.1;

// Blocks of a border from which on it is left out of the factor.
constexpr int kMinBorder = 24;

// Right sides solved at once: as many as a cache holds.
constexpr Eigen::Index kColumns = 64;

}  // namespace

RestSystem::RestSystem(int size, const Border& border)
    : b_(Eigen::VectorXd::Zero(size)), border_(border), bordered_(size, border) {
  if (dense()) H_.setZero(size, size);
}

bool RestSystem::dense() const { return b_.size() <= kMaxDense; }

void RestSystem::Clear() {
  b_.setZero();
  H_.setZero();
  added_ = 0;
}

void RestSystem::Add(const std::vector<int>& index, Eigen::MatrixXd H, const Eigen::VectorXd& b) {
  for (std::size_t j = 0; j < index.size(); ++j) {
    if (index[j] < 0) continue;
    b_[index[j]] += b[static_cast<Eigen::Index>(j)];
    if (!dense()) continue;
    for (std::size_t i = j; i < index.size(); ++i) {
      if (index[i] < 0) continue;
      H_(std::max(index[i], index[j]), std::min(index[i], index[j])) +=
          H(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j));
    }
  }
  if (dense()) return;
  if (added_ == terms_.size()) {
    terms_.push_back({index, std::move(H)});
    Forget();
  } else {
    SystemTerm& term = terms_[added_];
    if (term.index != index) {
      term.index = index;
      Forget();
    }
    term.H = std::move(H);
  }
  ++added_;
}

bool RestSystem::Factorize() {
  if (dense()) {
    dense_.compute(H_);
    return dense_.info() == Eigen::Success;
  }
  Shape();
  if (border_.blocks >= kMinBorder) return bordered_.Factorize(terms_);
  if (!factor_) factor_ = std::make_unique<Multifrontal>(size(), terms_);
  has_factor_ = factor_->Factorize(terms_);
  for (SystemTerm& term : terms_) term.H.resize(0, 0);
  return has_factor_;
}

bool RestSystem::FactorizeSimilar() {
  if (dense() || border_.blocks < kMinBorder) return Factorize();
  Shape();
  return bordered_.has_factor() || bordered_.FactorizeRoughly(terms_);
}

bool RestSystem::HoldsBorder() const {
  return !dense() && !(factor_ && has_factor_) && bordered_.has_factor();
}

void RestSystem::Forget() {
  factor_.reset();
  bordered_.Forget();
}

// Forgets a factor of another shape.
void RestSystem::Shape() {
  if (added_ == terms_.size()) return;
  terms_.resize(added_);
  Forget();
}

std::optional<Eigen::VectorXd> RestSystem::SolveSimilar() {
  if (!dense()) {
    Shape();
    if (border_.blocks >= kMinBorder) {
      if (auto x = bordered_.Solve(terms_, b_, kBorderedTolerance)) return x->col(0);
      return std::nullopt;
    }
    if (factor_ && has_factor_) {
      if (std::optional<Eigen::VectorXd> x = ConjugateGradients()) return x;
    }
  }
  if (!Factorize()) return std::nullopt;
  return Solve();
}

// Hestenes and Stiefel, preconditioned. Nothing if it does not get there.
std::optional<Eigen::VectorXd> RestSystem::ConjugateGradients() const {
  Eigen::VectorXd x = Eigen::VectorXd::Zero(b_.size());
  Eigen::VectorXd residual = b_;
  Eigen::VectorXd direction = factor_->Solve(residual);
  double squared = residual.dot(direction);
  const double enough = kTolerance * kTolerance * squared;
  double slow = squared;
  for (int i = 0; i < kMaxIterations && squared > enough; ++i) {
    const Eigen::VectorXd image = Times(terms_, direction);
    const double curvature = direction.dot(image);
    if (!(curvature > 0.0)) return std::nullopt;
    const double length = squared / curvature;
    x += length * direction;
    residual -= length * image;
    const Eigen::VectorXd preconditioned = factor_->Solve(residual);
    const double next = residual.dot(preconditioned);
    direction = preconditioned + next / squared * direction;
    squared = next;
    slow *= kLeastProgress;
    if (squared > slow) return std::nullopt;
  }
  if (!(squared <= enough)) return std::nullopt;
  return x;
}

Eigen::MatrixXd RestSystem::SolveFor(const Eigen::MatrixXd& b) const {
  return SolveTo(kExactTolerance, b);
}

Eigen::MatrixXd RestSystem::SolveForDraws(const Eigen::MatrixXd& b) const {
  return SolveTo(kBorderedTolerance, b);
}

Eigen::MatrixXd RestSystem::SolveTo(double bordered_tolerance, const Eigen::MatrixXd& b) const {
  if (dense()) return dense_.solve(b);
  if (!HoldsBorder()) return factor_->Solve(b);
  std::optional<Eigen::MatrixXd> x = bordered_.Solve(terms_, b, bordered_tolerance);
  SHIFTMAP_CHECK(x, "a system of {} unknowns is too badly conditioned", size());
  return *std::move(x);
}

Eigen::MatrixXd RestSystem::QuadraticForm(const std::vector<int>& index,
                                          const Eigen::MatrixXd& weights) const {
  if (HoldsBorder()) return bordered_.QuadraticForm(index, weights);
  if (!dense()) return factor_->QuadraticForm(index, weights);
  Eigen::MatrixXd x = Eigen::MatrixXd::Zero(size(), weights.cols());
  for (std::size_t i = 0; i < index.size(); ++i) {
    x.row(index[i]) = weights.row(static_cast<Eigen::Index>(i));
  }
  dense_.matrixL().solveInPlace(x);
  return x.transpose() * x;
}

Eigen::MatrixXd RestSystem::DrawTail(int size, const Eigen::MatrixXd& z) const {
  if (HoldsBorder()) return bordered_.DrawTail(size, z);
  if (dense()) return dense_.matrixU().solve(z).bottomRows(size);
  return factor_->SolveUpper(z).bottomRows(size);
}

Eigen::MatrixXd RestSystem::DrawColumns(int columns, std::mt19937_64& random) {
  std::optional<Eigen::MatrixXd> x = bordered_.Draw(terms_, columns, random);
  SHIFTMAP_CHECK(x, "a system of {} unknowns is too badly conditioned", size());
  return *std::move(x);
}

Eigen::MatrixXd RestSystem::BorderInformationTimes(const Eigen::MatrixXd& E) const {
  if (HoldsBorder()) return bordered_.BorderInformationTimes(terms_, E);
  Eigen::MatrixXd unit = Eigen::MatrixXd::Zero(size(), E.rows());
  unit.middleRows(border_.begin, E.rows()).setIdentity();
  const Eigen::MatrixXd covariance = SolveFor(unit).middleRows(border_.begin, E.rows());
  return covariance.llt().solve(E);
}

Eigen::MatrixXd RestSystem::TailCovariance(int size) const {
  Eigen::MatrixXd covariance(size, size);
  const Eigen::Index head = b_.size() - size;
  for (Eigen::Index first = 0; first < size; first += kColumns) {
    const Eigen::Index count = std::min<Eigen::Index>(kColumns, size - first);
    Eigen::MatrixXd unit = Eigen::MatrixXd::Zero(b_.size(), count);
    unit.middleRows(head + first, count).setIdentity();
    covariance.middleCols(first, count) = SolveFor(unit).bottomRows(size);
  }
  return covariance;
}

void RestSystem::VisitInverse(const InverseVisitor& visitor) const {
  if (HoldsBorder()) {
    bordered_.VisitInverse(visitor);
    return;
  }
  if (!dense()) {
    factor_->VisitInverse(visitor);
    return;
  }
  std::vector<int> unknowns(static_cast<std::size_t>(size()));
  std::iota(unknowns.begin(), unknowns.end(), 0);
  visitor(unknowns, size(), TailCovariance(size()));
}

}  // namespace shiftmap
