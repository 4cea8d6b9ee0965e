// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/bordered_solver.h"

#include <algorithm>
#include <utility>

namespace shiftmap {
namespace {

// Iterations on an earlier factor that cost less than another one, and on a factor of its own until
// a factor with the border in it is better.
constexpr int kMaxSimilar = 40;
constexpr int kMaxIterations = 200;

// Unknowns of a front from which on it is worth to cut the chains that cross it.
constexpr int kWideFront = 1500;

// Relative error of draws, which scatter by more however many there are.
constexpr double kDrawTolerance = 1e-2;

// Of what follows the border.
constexpr double kFollowTolerance = 1e-4;

}  // namespace

void BorderedSolver::Forget() {
  inner_.reset();
  has_factor_ = false;
  chain_.Forget();
}

std::optional<Eigen::MatrixXd> BorderedSolver::Solve(const std::vector<SystemTerm>& terms,
                                                     const Eigen::MatrixXd& b,
                                                     double tolerance) {
  if (!FactorizeBorder(terms)) return std::nullopt;
  if (has_factor()) {
    if (auto x = ConjugateGradients(terms, b, tolerance, kMaxSimilar)) return x;
  }
  if (border_.chained) {
    if (!chain_.CutsAll()) chain_ = ChainPreconditioner(size_, border_);
    has_factor_ = false;
    if (chain_.Factorize(terms)) {
      if (auto x = ConjugateGradients(terms, b, tolerance, kMaxIterations)) return x;
    }
  }
  if (!FactorizeInner(terms)) return std::nullopt;
  return ConjugateGradients(terms, b, tolerance, kMaxIterations);
}

bool BorderedSolver::Factorize(const std::vector<SystemTerm>& terms) {
  if (!FactorizeBorder(terms)) return false;
  has_factor_ = false;
  if (border_.chained) {
    if (!inner_) inner_ = std::make_unique<Multifrontal>(size_, terms, border_);
    // Narrow fronts cost little: what eliminates there stays exact.
    std::vector<bool> stays;
    for (int pose = 0; pose < border_.begin; pose += kChainRows) {
      stays.push_back(inner_->FrontWidth(pose) <= kWideFront);
    }
    if (std::find(stays.begin(), stays.end(), false) != stays.end()) {
      chain_ = ChainPreconditioner(size_, border_, std::move(stays));
      if (chain_.Factorize(terms)) return true;
    }
  }
  return FactorizeInner(terms);
}

bool BorderedSolver::FactorizeInner(const std::vector<SystemTerm>& terms) {
  if (!inner_) inner_ = std::make_unique<Multifrontal>(size_, terms, border_);
  has_factor_ = inner_->Factorize(terms);
  return has_factor_;
}

std::optional<Eigen::MatrixXd> BorderedSolver::Draw(const std::vector<SystemTerm>& terms,
                                                    int columns,
                                                    std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  Eigen::MatrixXd b = Eigen::MatrixXd::Zero(size_, columns);
  for (const SystemTerm& term : terms) {
    const Eigen::MatrixXd H = term.H.selfadjointView<Eigen::Lower>();
    const Eigen::LDLT<Eigen::MatrixXd> ldlt(H);
    Eigen::MatrixXd z(H.rows(), columns);
    for (double& value : z.reshaped()) value = normal(random);
    z = ldlt.vectorD().cwiseMax(0.0).cwiseSqrt().asDiagonal() * z;
    z = ldlt.transpositionsP().transpose() * Eigen::MatrixXd(ldlt.matrixL() * z);
    for (std::size_t i = 0; i < term.index.size(); ++i) {
      if (term.index[i] >= 0) b.row(term.index[i]) += z.row(static_cast<Eigen::Index>(i));
    }
  }
  return Solve(terms, b, kDrawTolerance);
}

Eigen::MatrixXd BorderedSolver::BorderInformationTimes(const std::vector<SystemTerm>& terms,
                                                       const Eigen::MatrixXd& E) const {
  Eigen::MatrixXd x = FollowBorder(terms, E);
  x.middleRows(border_.begin, E.rows()) = E;
  return Times(terms, x).middleRows(border_.begin, E.rows());
}

Eigen::MatrixXd BorderedSolver::FollowBorder(const std::vector<SystemTerm>& terms,
                                             const Eigen::MatrixXd& c) const {
  Eigen::MatrixXd b = -BorderTimes(terms, c);
  HoldBorder(&b);
  if (has_factor_) return SolveInner(b);
  const auto times = [&](const Eigen::MatrixXd& x) {
    Eigen::MatrixXd y = Times(terms, x);
    HoldBorder(&y);
    return y;
  };
  std::optional<Eigen::MatrixXd> x = ConjugateGradients(times, b, kFollowTolerance, kMaxIterations);
  return x ? *std::move(x) : Precondition(b);
}

Eigen::MatrixXd BorderedSolver::FollowBorderAsVisited(const std::vector<SystemTerm>& terms,
                                                      const Eigen::MatrixXd& c) const {
  return -Precondition(BorderTimes(terms, c));
}

void BorderedSolver::HoldBorder(Eigen::MatrixXd* x) const {
  x->middleRows(border_.begin, border_.end() - border_.begin).setZero();
}

void BorderedSolver::VisitInverse(const InverseVisitor& visitor) const {
  if (!has_factor_) {
    chain_.VisitInverse(visitor);
    return;
  }
  std::vector<int> outer;
  inner_->VisitInverse([&](const std::vector<int>& unknowns, int own, const Eigen::MatrixXd& Z) {
    outer.clear();
    for (const int unknown : unknowns) {
      outer.push_back(unknown < border_.begin ? unknown : unknown + border_.blocks * border_.size);
    }
    visitor(outer, own, Z);
  });
}

bool BorderedSolver::FactorizeBorder(const std::vector<SystemTerm>& terms) {
  std::vector<Eigen::MatrixXd> C(static_cast<std::size_t>(border_.blocks),
                                 Eigen::MatrixXd::Zero(border_.size, border_.size));
  for (const SystemTerm& term : terms) {
    for (std::size_t j = 0; j < term.index.size(); ++j) {
      const int column = term.index[j] - border_.begin;
      if (column < 0 || term.index[j] >= border_.end()) continue;
      Eigen::MatrixXd& block = C[static_cast<std::size_t>(column / border_.size)];
      for (std::size_t i = j; i < term.index.size(); ++i) {
        const int row = term.index[i] - border_.begin;
        if (row < 0 || term.index[i] >= border_.end()) continue;
        block(std::max(row, column) % border_.size, std::min(row, column) % border_.size) +=
            term.H(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j));
      }
    }
  }
  blocks_.clear();
  for (const Eigen::MatrixXd& block : C) {
    if (blocks_.emplace_back(block).info() != Eigen::Success) return false;
  }
  return true;
}

// [B; C] c: only those columns of each term take part.
Eigen::MatrixXd BorderedSolver::BorderTimes(const std::vector<SystemTerm>& terms,
                                            const Eigen::MatrixXd& c) const {
  Eigen::MatrixXd y = Eigen::MatrixXd::Zero(size_, c.cols());
  Eigen::MatrixXd local;
  for (const SystemTerm& term : terms) {
    const auto size = static_cast<Eigen::Index>(term.index.size());
    local.setZero(size, c.cols());
    for (Eigen::Index k = 0; k < size; ++k) {
      const int unknown = term.index[static_cast<std::size_t>(k)];
      if (unknown < border_.begin || unknown >= border_.end()) continue;
      const auto c_k = c.row(unknown - border_.begin);
      local.topRows(k).noalias() += term.H.row(k).head(k).transpose() * c_k;
      local.bottomRows(size - k).noalias() += term.H.col(k).tail(size - k) * c_k;
    }
    for (Eigen::Index i = 0; i < size; ++i) {
      const int unknown = term.index[static_cast<std::size_t>(i)];
      if (unknown >= 0) y.row(unknown) += local.row(i);
    }
  }
  return y;
}

// C⁻¹ in the rows of the border, zero in the others.
Eigen::MatrixXd BorderedSolver::SolveBorder(const Eigen::MatrixXd& c) const {
  Eigen::MatrixXd x = Eigen::MatrixXd::Zero(size_, c.cols());
  for (int block = 0; block < border_.blocks; ++block) {
    const int row = border_.begin + block * border_.size;
    x.middleRows(row, border_.size) =
        blocks_[static_cast<std::size_t>(block)].solve(c.middleRows(row, border_.size));
  }
  return x;
}

// b - [B; C] C⁻¹ b_c, which is zero in the rows of the border.
Eigen::MatrixXd BorderedSolver::Reduce(const std::vector<SystemTerm>& terms,
                                       const Eigen::MatrixXd& b) const {
  const int width = border_.end() - border_.begin;
  const Eigen::MatrixXd c = SolveBorder(b).middleRows(border_.begin, width);
  Eigen::MatrixXd reduced = b - BorderTimes(terms, c);
  HoldBorder(&reduced);
  return reduced;
}

// The rows that are not in the border.
Eigen::MatrixXd BorderedSolver::Inner(const Eigen::MatrixXd& x) const {
  const Eigen::Index below = size_ - border_.end();
  Eigen::MatrixXd inner(border_.begin + below, x.cols());
  inner << x.topRows(border_.begin), x.bottomRows(below);
  return inner;
}

// The same with zeros in the border.
Eigen::MatrixXd BorderedSolver::Outer(const Eigen::MatrixXd& inner) const {
  Eigen::MatrixXd x = Eigen::MatrixXd::Zero(size_, inner.cols());
  x.topRows(border_.begin) = inner.topRows(border_.begin);
  x.bottomRows(size_ - border_.end()) = inner.bottomRows(size_ - border_.end());
  return x;
}

Eigen::MatrixXd BorderedSolver::QuadraticForm(const std::vector<int>& index,
                                              const Eigen::MatrixXd& weights) const {
  if (!has_factor_) return chain_.QuadraticForm(index, weights);
  std::vector<int> rows;
  std::vector<int> unknowns;
  for (std::size_t i = 0; i < index.size(); ++i) {
    if (index[i] >= border_.begin && index[i] < border_.end()) continue;
    rows.push_back(static_cast<int>(i));
    unknowns.push_back(index[i] < border_.begin ? index[i]
                                                : index[i] - border_.blocks * border_.size);
  }
  return inner_->QuadraticForm(unknowns, weights(rows, Eigen::all));
}

Eigen::MatrixXd BorderedSolver::SolveUpper(const Eigen::MatrixXd& z) const {
  if (!has_factor_) return chain_.SolveUpper(z);
  return Outer(inner_->SolveUpper(Inner(z)));
}

// A⁻¹ b outside the border.
Eigen::MatrixXd BorderedSolver::SolveInner(const Eigen::MatrixXd& b) const {
  return Outer(inner_->Solve(Inner(b)));
}

// A⁻¹ b or nearly that.
Eigen::MatrixXd BorderedSolver::Precondition(const Eigen::MatrixXd& b) const {
  return has_factor_ ? SolveInner(b) : chain_.Solve(b);
}

std::optional<Eigen::MatrixXd> BorderedSolver::ConjugateGradients(
    const std::vector<SystemTerm>& terms,
    const Eigen::MatrixXd& b,
    double tolerance,
    int max_iterations) const {
  const auto times = [&](const Eigen::MatrixXd& x) { return Reduce(terms, Times(terms, x)); };
  const std::optional<Eigen::MatrixXd> x =
      ConjugateGradients(times, Reduce(terms, b), tolerance, max_iterations);
  if (!x) return std::nullopt;
  // The border, given the others.
  return *x + SolveBorder(b - Times(terms, *x));
}

// Each column by itself, side by side.
template <typename Product>
std::optional<Eigen::MatrixXd> BorderedSolver::ConjugateGradients(const Product& times,
                                                                  Eigen::MatrixXd residual,
                                                                  double tolerance,
                                                                  int max_iterations) const {
  const auto dots = [](const Eigen::MatrixXd& u, const Eigen::MatrixXd& v) -> Eigen::ArrayXd {
    return u.cwiseProduct(v).colwise().sum().transpose();
  };
  // Columns that are done, or zero, stay.
  const auto ratio = [](const Eigen::ArrayXd& u, const Eigen::ArrayXd& v) -> Eigen::ArrayXd {
    return (v > 0.0).select(u / v, 0.0);
  };
  Eigen::MatrixXd x = Eigen::MatrixXd::Zero(size_, residual.cols());
  Eigen::MatrixXd direction = Precondition(residual);
  Eigen::ArrayXd squared = dots(residual, direction);
  const Eigen::ArrayXd enough = tolerance * tolerance * squared;
  for (int i = 0; i < max_iterations && (squared > enough).any(); ++i) {
    const Eigen::MatrixXd image = times(direction);
    const Eigen::ArrayXd curvature = dots(direction, image);
    if ((curvature < 0.0).any() || !curvature.allFinite()) return std::nullopt;
    const Eigen::ArrayXd length = ratio(squared, curvature);
    x += direction * length.matrix().asDiagonal();
    residual -= image * length.matrix().asDiagonal();
    const Eigen::MatrixXd preconditioned = Precondition(residual);
    const Eigen::ArrayXd next = dots(residual, preconditioned);
    direction = preconditioned + direction * ratio(next, squared).matrix().asDiagonal();
    squared = next;
  }
  if (!(squared <= enough).all()) return std::nullopt;
  return x;
}

}  // namespace shiftmap
