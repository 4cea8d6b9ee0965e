// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/segment.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <utility>

namespace shiftmap {

SegmentSystem::SegmentSystem(int poses, int boundary)
    : A(static_cast<std::size_t>(poses), Eigen::Matrix3d::Zero()),
      E(static_cast<std::size_t>(std::max(poses - 1, 0)), Eigen::Matrix3d::Zero()),
      B(Eigen::MatrixXd::Zero(3 * poses, boundary)),
      b(Eigen::VectorXd::Zero(3 * poses)),
      C(Eigen::MatrixXd::Zero(boundary, boundary)),
      c(Eigen::VectorXd::Zero(boundary)) {}

void SegmentSystem::Damp(double share) {
  for (Eigen::Matrix3d& block : A) block.diagonal() *= 1.0 + share;
  C.diagonal() *= 1.0 + share;
}

bool Segment::Eliminate(SegmentSystem* system) {
  std::vector<Eigen::Matrix3d>& A = system->A;
  L_.resize(A.size());
  F_.resize(system->E.size());
  Y_ = std::move(system->B);
  u_ = std::move(system->b);
  for (std::size_t i = 0; i < A.size(); ++i) {
    const auto row = static_cast<Eigen::Index>(3 * i);
    const Eigen::LLT<Eigen::Matrix3d> llt(A[i]);
    if (llt.info() != Eigen::Success) return false;
    L_[i] = llt.matrixL();
    auto Y = Y_.middleRows<3>(row);
    llt.matrixL().solveInPlace(Y);
    auto u = u_.segment<3>(row);
    llt.matrixL().solveInPlace(u);
    if (i + 1 == A.size()) break;
    F_[i] = system->E[i];
    llt.matrixL().solveInPlace(F_[i]);
    A[i + 1].noalias() -= F_[i].transpose() * F_[i];
    Y_.middleRows<3>(row + 3).noalias() -= F_[i].transpose() * Y;
    u_.segment<3>(row + 3).noalias() -= F_[i].transpose() * u;
  }
  if (A.empty()) return true;
  system->C.selfadjointView<Eigen::Lower>().rankUpdate(Y_.transpose(), -1.0);
  system->c.noalias() -= Y_.transpose() * u_;
  return true;
}

Eigen::VectorXd Segment::BackSubstitute(const Eigen::VectorXd& noise,
                                        const Eigen::VectorXd& boundary) const {
  Eigen::VectorXd x = noise - Y_ * boundary;
  for (std::size_t i = L_.size(); i-- > 0;) {
    const auto row = static_cast<Eigen::Index>(3 * i);
    auto x_i = x.segment<3>(row);
    if (i + 1 < L_.size()) x_i.noalias() -= F_[i] * x.segment<3>(row + 3);
    L_[i].triangularView<Eigen::Lower>().transpose().solveInPlace(x_i);
  }
  return x;
}

}  // namespace shiftmap
