// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/cholesky_factor.h"

#include <algorithm>
#include <cstddef>
#include <numeric>
#include <utility>

namespace shiftmap {
namespace {

// Right sides solved at once: as many as a cache holds.
constexpr int kColumns = 64;

class DenseFactor final : public CholeskyFactor {
 public:
  explicit DenseFactor(Eigen::LLT<Eigen::MatrixXd> llt) : llt_(std::move(llt)) {}

  int size() const override { return static_cast<int>(llt_.rows()); }

  Eigen::MatrixXd Solve(const Eigen::MatrixXd& b) const override { return llt_.solve(b); }

  Eigen::MatrixXd SolveUpper(const Eigen::MatrixXd& z) const override {
    return llt_.matrixU().solve(z);
  }

  Eigen::MatrixXd QuadraticForm(const std::vector<int>& unknowns,
                                const Eigen::MatrixXd& weights) const override {
    Eigen::MatrixXd x = Eigen::MatrixXd::Zero(size(), weights.cols());
    for (std::size_t i = 0; i < unknowns.size(); ++i) {
      x.row(unknowns[i]) = weights.row(static_cast<Eigen::Index>(i));
    }
    llt_.matrixL().solveInPlace(x);
    return x.transpose() * x;
  }

  void VisitInverse(const InverseVisitor& visitor) const override {
    std::vector<int> unknowns(static_cast<std::size_t>(size()));
    std::iota(unknowns.begin(), unknowns.end(), 0);
    visitor(unknowns, size(), CovarianceBlock(0, size()));
  }

 private:
  Eigen::LLT<Eigen::MatrixXd> llt_;
};

}  // namespace

Eigen::MatrixXd CholeskyFactor::CovarianceBlock(int first, int count) const {
  Eigen::MatrixXd block(count, count);
  for (int column = 0; column < count; column += kColumns) {
    const int columns = std::min(kColumns, count - column);
    Eigen::MatrixXd unit = Eigen::MatrixXd::Zero(size(), columns);
    unit.middleRows(first + column, columns).setIdentity();
    block.middleCols(column, columns) = Solve(unit).middleRows(first, count);
  }
  return block;
}

std::shared_ptr<const CholeskyFactor> MakeDenseFactor(const Eigen::MatrixXd& H) {
  Eigen::LLT<Eigen::MatrixXd> llt(H);
  if (llt.info() != Eigen::Success) return nullptr;
  return std::make_shared<DenseFactor>(std::move(llt));
}

}  // namespace shiftmap
