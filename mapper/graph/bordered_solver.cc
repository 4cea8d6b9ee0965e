// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/bordered_solver.h"

#include <utility>

namespace shiftmap {
namespace {

// Iterations on an earlier factor that cost less than another one, and on a factor of its own until
// one with no chain cut is better.
constexpr int kMaxSimilar = 24;
constexpr int kMaxIterations = 200;

// Chains that pass where one is cut. Of few a good part of what ties the modes there would be lost:
// for solves that is another iteration, for covariances it is not told.
constexpr int kSome = 4;
constexpr int kMany = 12;

// Relative error of draws, which scatter by more however many there are.
constexpr double kDrawTolerance = 1e-2;

// Of what follows the border.
constexpr double kFollowTolerance = 1e-4;

}  // namespace

void BorderedSolver::Forget() {
  chains_.reset();
  factor_.reset();
  has_factor_ = false;
}

void BorderedSolver::Adopt(ChainElimination chains) {
  factor_ = std::make_unique<Multifrontal>(static_cast<int>(chains.others().size()),
                                           chains.ShapeOfCutTerms());
  chains_ = std::move(chains);
}

// False if terms have other poses than chains have.
bool BorderedSolver::ShapeFor(Cuts cuts, const std::vector<SystemTerm>& terms) {
  if (chains_ && cuts_ == cuts) return true;
  Forget();
  cuts_ = cuts;
  if (cuts == Cuts::kNone) {
    Adopt(ChainElimination::OfBorder(size_, border_, terms));
    return true;
  }
  std::optional<ChainElimination> chains = ChainElimination::OfPoses(
      size_, border_, terms, cuts == Cuts::kWhereManyPass ? kMany : kSome);
  if (!chains) return false;
  Adopt(*std::move(chains));
  return true;
}

bool BorderedSolver::FactorizeWith(Cuts cuts, const std::vector<SystemTerm>& terms) {
  has_factor_ = false;
  if (!ShapeFor(cuts, terms) || !chains_->Eliminate(terms)) return false;
  const std::optional<std::vector<SystemTerm>> cut = chains_->CutTerms(terms);
  has_factor_ = cut && factor_->Factorize(*cut);
  return has_factor_;
}

std::optional<Eigen::MatrixXd> BorderedSolver::Solve(const std::vector<SystemTerm>& terms,
                                                     const Eigen::MatrixXd& b,
                                                     double tolerance) {
  if (has_factor_ && chains_->Eliminate(terms)) {
    if (auto x = ConjugateGradients(false, b, tolerance, kMaxSimilar)) return x;
  }
  if (border_.chained && FactorizeWith(Cuts::kWhereSomePass, terms)) {
    if (auto x = ConjugateGradients(false, b, tolerance, kMaxIterations)) return x;
  }
  if (!FactorizeWith(Cuts::kNone, terms)) return std::nullopt;
  return ConjugateGradients(false, b, tolerance, kMaxIterations);
}

// With no cuts where those do not do.
bool BorderedSolver::FactorizeCut(Cuts cuts, const std::vector<SystemTerm>& terms) {
  if (border_.chained && FactorizeWith(cuts, terms)) return true;
  return FactorizeWith(Cuts::kNone, terms);
}

bool BorderedSolver::Factorize(const std::vector<SystemTerm>& terms) {
  return FactorizeCut(Cuts::kWhereManyPass, terms);
}

bool BorderedSolver::FactorizeRoughly(const std::vector<SystemTerm>& terms) {
  return FactorizeCut(Cuts::kWhereSomePass, terms);
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
  const Eigen::MatrixXd b = -BorderTimes(terms, c);
  std::optional<Eigen::MatrixXd> x = ConjugateGradients(true, b, kFollowTolerance, kMaxIterations);
  return x ? *std::move(x) : SolveHeld(b);
}

Eigen::MatrixXd BorderedSolver::FollowBorderAsVisited(const std::vector<SystemTerm>& terms,
                                                      const Eigen::MatrixXd& c) const {
  return SolveHeld(-BorderTimes(terms, c));
}

Eigen::MatrixXd BorderedSolver::SolveHeld(const Eigen::MatrixXd& b) const {
  ChainElimination::Parts parts = chains_->Split(b);
  chains_->Reduce(true, &parts);
  parts.others = factor_->Solve(parts.others);
  chains_->Complete(true, &parts);
  return chains_->Join(parts);
}

void BorderedSolver::VisitInverse(const InverseVisitor& visitor) const {
  std::vector<int> unknowns;
  factor_->VisitInverse([&](const std::vector<int>& rows, int own, const Eigen::MatrixXd& Z) {
    unknowns.clear();
    for (const int row : rows) {
      unknowns.push_back(chains_->others()[static_cast<std::size_t>(row)]);
    }
    visitor(unknowns, own, Z);
  });
}

// [B; C] c.
Eigen::MatrixXd BorderedSolver::BorderTimes(const std::vector<SystemTerm>& terms,
                                            const Eigen::MatrixXd& c) const {
  Eigen::MatrixXd x = Eigen::MatrixXd::Zero(size_, c.cols());
  x.middleRows(border_.begin, c.rows()) = c;
  return Times(terms, x);
}

Eigen::MatrixXd BorderedSolver::QuadraticForm(const std::vector<int>& index,
                                              const Eigen::MatrixXd& weights) const {
  std::vector<int> rows;  // Of W.
  std::vector<int> others;
  for (std::size_t i = 0; i < index.size(); ++i) {
    const int other = chains_->RowOf(index[i]);
    if (other < 0) continue;
    rows.push_back(static_cast<int>(i));
    others.push_back(other);
  }
  return factor_->QuadraticForm(others, weights(rows, Eigen::all));
}

Eigen::MatrixXd BorderedSolver::DrawTail(int size, const Eigen::MatrixXd& z) const {
  const Eigen::MatrixXd others = factor_->SolveUpper(z);
  Eigen::MatrixXd tail = Eigen::MatrixXd::Zero(size, z.cols());
  for (int i = 0; i < size; ++i) {
    const int row = chains_->RowOf(size_ - size + i);
    if (row >= 0) tail.row(i) = others.row(row);
  }
  return tail;
}

// H⁻¹ b of what chains_ eliminated, or, the border held, A⁻¹ b.
std::optional<Eigen::MatrixXd> BorderedSolver::ConjugateGradients(bool held,
                                                                  const Eigen::MatrixXd& b,
                                                                  double tolerance,
                                                                  int max_iterations) const {
  ChainElimination::Parts parts = chains_->Split(b);
  chains_->Reduce(held, &parts);
  std::optional<Eigen::MatrixXd> x =
      SolveOthers(held, std::move(parts.others), tolerance, max_iterations);
  if (!x) return std::nullopt;
  parts.others = *std::move(x);
  chains_->Complete(held, &parts);
  return chains_->Join(parts);
}

// Each column by itself, side by side.
std::optional<Eigen::MatrixXd> BorderedSolver::SolveOthers(bool held,
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
  Eigen::MatrixXd x = Eigen::MatrixXd::Zero(residual.rows(), residual.cols());
  Eigen::MatrixXd direction = factor_->Solve(residual);
  Eigen::ArrayXd squared = dots(residual, direction);
  const Eigen::ArrayXd enough = tolerance * tolerance * squared;
  for (int i = 0; i < max_iterations && (squared > enough).any(); ++i) {
    const Eigen::MatrixXd image = chains_->Times(held, direction);
    const Eigen::ArrayXd curvature = dots(direction, image);
    if ((curvature < 0.0).any() || !curvature.allFinite()) return std::nullopt;
    const Eigen::ArrayXd length = ratio(squared, curvature);
    x += direction * length.matrix().asDiagonal();
    residual -= image * length.matrix().asDiagonal();
    const Eigen::MatrixXd preconditioned = factor_->Solve(residual);
    const Eigen::ArrayXd next = dots(residual, preconditioned);
    direction = preconditioned + direction * ratio(next, squared).matrix().asDiagonal();
    squared = next;
  }
  if (!(squared <= enough).all()) return std::nullopt;
  return x;
}

}  // namespace shiftmap
