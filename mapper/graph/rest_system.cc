// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/rest_system.h"

#include <algorithm>
#include <numeric>
#include <utility>

namespace shiftmap {
namespace {

// Up to here a dense factor is faster than ordering a sparse one.
constexpr int kMaxDense = 400;

// Right sides solved at once: as many as a cache holds.
constexpr Eigen::Index kColumns = 64;

}  // namespace

RestSystem::RestSystem(int size) : b_(Eigen::VectorXd::Zero(size)) {
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
    factor_.reset();
  } else {
    SystemTerm& term = terms_[added_];
    if (term.index != index) {
      term.index = index;
      factor_.reset();
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
  if (added_ < terms_.size()) {
    terms_.resize(added_);
    factor_.reset();
  }
  if (!factor_) factor_ = std::make_unique<Multifrontal>(size(), terms_);
  const bool positive = factor_->Factorize(terms_);
  for (SystemTerm& term : terms_) term.H.resize(0, 0);
  return positive;
}

Eigen::MatrixXd RestSystem::SolveFor(const Eigen::MatrixXd& b) const {
  if (dense()) return dense_.solve(b);
  return factor_->Solve(b);
}

Eigen::VectorXd RestSystem::Draw(const Eigen::VectorXd& z) const {
  if (dense()) return dense_.matrixU().solve(z);
  return factor_->SolveUpper(z);
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
  if (!dense()) {
    factor_->VisitInverse(visitor);
    return;
  }
  std::vector<int> unknowns(static_cast<std::size_t>(size()));
  std::iota(unknowns.begin(), unknowns.end(), 0);
  visitor(unknowns, size(), TailCovariance(size()));
}

}  // namespace shiftmap
