// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/segment.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace shiftmap {
namespace {

// L of L Lᵀ = A by its lower triangle, with the inverse of its diagonal, which is what solving
// needs. False if A is not positive definite.
bool FactorizeBlock(const Eigen::Matrix3d& A, Eigen::Matrix3d* L) {
  L->setZero();
  for (int j = 0; j < 3; ++j) {
    double pivot = A(j, j);
    for (int k = 0; k < j; ++k) pivot -= (*L)(j, k) * (*L)(j, k);
    if (!(pivot > 0.0)) return false;
    const double inverse = 1.0 / std::sqrt(pivot);
    (*L)(j, j) = inverse;
    for (int i = j + 1; i < 3; ++i) {
      double entry = A(i, j);
      for (int k = 0; k < j; ++k) entry -= (*L)(i, k) * (*L)(j, k);
      (*L)(i, j) = inverse * entry;
    }
  }
  return true;
}

// y := L⁻¹ y for three rows of `width` numbers, one after the other. General solvers of triangular
// systems take ten times as long for as few rows.
void SolveRows(const Eigen::Matrix3d& L, Eigen::Index width, double* y) {
  double* __restrict__ y_0 = y;
  double* __restrict__ y_1 = y + width;
  double* __restrict__ y_2 = y + 2 * width;
  const double l_10 = L(1, 0);
  const double l_20 = L(2, 0);
  const double l_21 = L(2, 1);
  for (Eigen::Index c = 0; c < width; ++c) {
    const double first = L(0, 0) * y_0[c];
    const double second = L(1, 1) * (y_1[c] - l_10 * first);
    y_0[c] = first;
    y_1[c] = second;
    y_2[c] = L(2, 2) * (y_2[c] - l_20 * first - l_21 * second);
  }
}

// next -= Fᵀ y, three rows of `width` numbers each.
void SubtractRows(const Eigen::Matrix3d& F, Eigen::Index width, const double* y, double* next) {
  const double* y_0 = y;
  const double* y_1 = y + width;
  const double* y_2 = y + 2 * width;
  for (int row = 0; row < 3; ++row) {
    double* __restrict__ out = next + row * width;
    const double f_0 = F(0, row);
    const double f_1 = F(1, row);
    const double f_2 = F(2, row);
    for (Eigen::Index c = 0; c < width; ++c) {
      out[c] -= f_0 * y_0[c] + f_1 * y_1[c] + f_2 * y_2[c];
    }
  }
}

}  // namespace

SegmentSystem::SegmentSystem(int poses, int boundary)
    : A(static_cast<std::size_t>(poses), Eigen::Matrix3d::Zero()),
      E(static_cast<std::size_t>(std::max(poses - 1, 0)), Eigen::Matrix3d::Zero()),
      B(Eigen::MatrixXd::Zero(Eigen::Index{3} * poses, boundary)),
      b(Eigen::VectorXd::Zero(Eigen::Index{3} * poses)),
      C(Eigen::MatrixXd::Zero(boundary, boundary)),
      c(Eigen::VectorXd::Zero(boundary)) {}

void SegmentSystem::Damp(double share) {
  for (Eigen::Matrix3d& block : A) block.diagonal() *= 1.0 + share;
  C.diagonal() *= 1.0 + share;
}

std::optional<SegmentFactor> SegmentFactor::Of(SegmentSystem* system) {
  SegmentFactor factor;
  if (!factor.Factorize(system)) return std::nullopt;
  return factor;
}

bool SegmentFactor::Factorize(SegmentSystem* system) {
  std::vector<Eigen::Matrix3d>& A = system->A;
  L_.resize(A.size());
  F_.resize(system->E.size());
  Y_ = std::move(system->B);
  u_ = std::move(system->b);
  const Eigen::Index width = Y_.cols();
  for (std::size_t i = 0; i < A.size(); ++i) {
    const auto row = static_cast<Eigen::Index>(3 * i);
    if (!FactorizeBlock(A[i], &L_[i])) return false;
    double* Y = Y_.data() + row * width;
    double* u = u_.data() + row;
    SolveRows(L_[i], width, Y);
    SolveRows(L_[i], 1, u);
    if (i + 1 == A.size()) break;
    // By rows, as SolveRows() has them.
    Eigen::Matrix<double, 3, 3, Eigen::RowMajor> F = system->E[i];
    SolveRows(L_[i], 3, F.data());
    F_[i] = F;
    A[i + 1].noalias() -= F_[i].transpose() * F_[i];
    SubtractRows(F_[i], width, Y, Y + 3 * width);
    SubtractRows(F_[i], 1, u, u + 3);
  }
  if (A.empty()) return true;
  system->C.selfadjointView<Eigen::Lower>().rankUpdate(Y_.transpose(), -1.0);
  system->c.noalias() -= Y_.transpose() * u_;
  return true;
}

void SegmentFactor::Eliminate(PoseRows* b, Eigen::MatrixXd* c) const {
  const Eigen::Index width = b->cols();
  for (std::size_t i = 0; i < L_.size(); ++i) {
    double* rows = b->data() + static_cast<Eigen::Index>(3 * i) * width;
    SolveRows(L_[i], width, rows);
    if (i + 1 < L_.size()) SubtractRows(F_[i], width, rows, rows + 3 * width);
  }
  if (!L_.empty()) c->noalias() -= Y_.transpose() * *b;
}

Eigen::VectorXd SegmentFactor::BackSubstitute(const Eigen::VectorXd& u,
                                              const Eigen::VectorXd& boundary) const {
  Eigen::VectorXd x = u;
  x.noalias() -= Y_ * boundary;
  for (std::size_t i = L_.size(); i-- > 0;) {
    const auto row = static_cast<Eigen::Index>(3 * i);
    Eigen::Vector3d x_i = x.segment<3>(row);
    if (i + 1 < L_.size()) x_i -= F_[i] * x.segment<3>(row + 3);
    const Eigen::Matrix3d& L = L_[i];
    x_i[2] *= L(2, 2);
    x_i[1] = L(1, 1) * (x_i[1] - L(2, 1) * x_i[2]);
    x_i[0] = L(0, 0) * (x_i[0] - L(1, 0) * x_i[1] - L(2, 0) * x_i[2]);
    x.segment<3>(row) = x_i;
  }
  return x;
}

}  // namespace shiftmap
