// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/rest_system.h"

#include <algorithm>

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

void RestSystem::Add(const std::vector<int>& index,
                     const Eigen::MatrixXd& H,
                     const Eigen::VectorXd& b) {
  for (std::size_t j = 0; j < index.size(); ++j) {
    if (index[j] < 0) continue;
    const auto column = static_cast<Eigen::Index>(j);
    b_[index[j]] += b[column];
    for (std::size_t i = j; i < index.size(); ++i) {
      if (index[i] < 0) continue;
      const int row_in_H = std::max(index[i], index[j]);
      const int column_in_H = std::min(index[i], index[j]);
      const double value = H(static_cast<Eigen::Index>(i), column);
      if (dense()) {
        H_(row_in_H, column_in_H) += value;
      } else if (value != 0.0) {
        entries_.emplace_back(row_in_H, column_in_H, value);
      }
    }
  }
}

bool RestSystem::Factorize() {
  if (dense()) {
    dense_.compute(H_);
    return dense_.info() == Eigen::Success;
  }
  Sparse H(b_.size(), b_.size());
  H.setFromTriplets(entries_.begin(), entries_.end());
  std::vector<Eigen::Triplet<double>>().swap(entries_);
  sparse_.compute(H);
  return sparse_.info() == Eigen::Success;
}

Eigen::MatrixXd RestSystem::SolveFor(const Eigen::MatrixXd& b) const {
  if (dense()) return dense_.solve(b);
  return sparse_.solve(b);
}

Eigen::VectorXd RestSystem::Draw(const Eigen::VectorXd& z) const {
  if (dense()) return dense_.matrixU().solve(z);
  const Eigen::VectorXd permuted = sparse_.matrixU().solve(z);
  return sparse_.permutationPinv() * permuted;
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

}  // namespace shiftmap
