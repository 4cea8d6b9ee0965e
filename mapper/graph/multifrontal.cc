// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/multifrontal.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <numeric>
#include <utility>

#include "proto/core/check.h"

namespace shiftmap {
namespace {

Eigen::Index Index(std::size_t i) { return static_cast<Eigen::Index>(i); }

// Triangular solve in place. For several columns Eigen copies the triangle, which pays for many.
template <typename Triangle>
void SolveTriangle(const Triangle& triangle, Eigen::Ref<Eigen::MatrixXd> x) {
  if (x.cols() > 1) {
    triangle.solveInPlace(x);
    return;
  }
  auto column = x.col(0);
  triangle.solveInPlace(column);
}

}  // namespace

Eigen::MatrixXd Times(const std::vector<SystemTerm>& terms, const Eigen::MatrixXd& x) {
  Eigen::MatrixXd y = Eigen::MatrixXd::Zero(x.rows(), x.cols());
  Eigen::MatrixXd local;
  for (const SystemTerm& term : terms) {
    local.setZero(Index(term.index.size()), x.cols());
    for (std::size_t i = 0; i < term.index.size(); ++i) {
      if (term.index[i] >= 0) local.row(Index(i)) = x.row(term.index[i]);
    }
    if (local.cols() > 1) {
      local = (term.H.selfadjointView<Eigen::Lower>() * local).eval();
    } else {
      local.col(0) = (term.H.selfadjointView<Eigen::Lower>() * local.col(0)).eval();
    }
    for (std::size_t i = 0; i < term.index.size(); ++i) {
      if (term.index[i] >= 0) y.row(term.index[i]) += local.row(Index(i));
    }
  }
  return y;
}

Multifrontal::Multifrontal(int size, const std::vector<SystemTerm>& terms) {
  FindNodes(size, terms);
  MakeFactors(terms);
  local_.resize(static_cast<std::size_t>(size));
}

// Consecutive unknowns that every term has together or not at all are one node.
void Multifrontal::FindNodes(int size, const std::vector<SystemTerm>& terms) {
  const auto count = static_cast<std::size_t>(size);
  std::vector<bool> begins(count + 1);
  std::vector<int> mark(count, -1);
  for (std::size_t t = 0; t < terms.size(); ++t) {
    const auto term = static_cast<int>(t);
    const auto has = [&](int unknown) {
      return unknown >= 0 && unknown < size && mark[static_cast<std::size_t>(unknown)] == term;
    };
    for (const int unknown : terms[t].index) {
      if (unknown >= 0) mark[static_cast<std::size_t>(unknown)] = term;
    }
    for (const int unknown : terms[t].index) {
      if (unknown < 0) continue;
      if (!has(unknown - 1)) begins[static_cast<std::size_t>(unknown)] = true;
      if (!has(unknown + 1)) begins[static_cast<std::size_t>(unknown) + 1] = true;
    }
  }
  for (std::size_t i = 0; i < count; ++i) {
    if (i == 0 || begins[i]) node_begin_.push_back(static_cast<int>(i));
    node_of_.push_back(static_cast<int>(node_begin_.size()) - 1);
  }
  node_begin_.push_back(size);
}

void Multifrontal::MakeFactors(const std::vector<SystemTerm>& terms) {
  std::vector<int> sizes;
  for (std::size_t n = 0; n + 1 < node_begin_.size(); ++n) {
    sizes.push_back(node_begin_[n + 1] - node_begin_[n]);
  }
  std::vector<std::vector<int>> cliques;
  for (const SystemTerm& term : terms) {
    std::vector<int> nodes;
    for (const int unknown : term.index) {
      if (unknown < 0) continue;
      const int node = node_of_[static_cast<std::size_t>(unknown)];
      if (node_begin_[static_cast<std::size_t>(node)] == unknown) nodes.push_back(node);
    }
    cliques.push_back(std::move(nodes));
  }
  const EliminationTree tree = MakeEliminationTree(sizes, cliques);

  place_.resize(node_of_.size());
  for (const Front& front : tree.fronts) {
    for (int i = 0; i < front.own; ++i) {
      const int node = front.rows[static_cast<std::size_t>(i)];
      for (int k = 0; k < sizes[static_cast<std::size_t>(node)]; ++k) {
        const int unknown = node_begin_[static_cast<std::size_t>(node)] + k;
        place_[static_cast<std::size_t>(unknown)] = static_cast<int>(unknown_.size());
        unknown_.push_back(unknown);
      }
    }
  }
  for (std::size_t f = 0; f < tree.fronts.size(); ++f) {
    for (int i = 0; i < tree.fronts[f].own; ++i) {
      const auto node = static_cast<std::size_t>(tree.fronts[f].rows[static_cast<std::size_t>(i)]);
      front_.insert(front_.end(), static_cast<std::size_t>(sizes[node]), static_cast<int>(f));
    }
  }
  children_.resize(tree.fronts.size());
  for (std::size_t f = 0; f < tree.fronts.size(); ++f) {
    const Front& front = tree.fronts[f];
    Factor factor;
    factor.parent = front.parent;
    for (std::size_t i = 0; i < front.rows.size(); ++i) {
      const auto node = static_cast<std::size_t>(front.rows[i]);
      const int first = place_[static_cast<std::size_t>(node_begin_[node])];
      for (int k = 0; k < sizes[node]; ++k) factor.rows.push_back(first + k);
      if (static_cast<int>(i) < front.own) factor.own += sizes[node];
    }
    factors_.push_back(std::move(factor));
    if (front.parent >= 0) {
      children_[static_cast<std::size_t>(front.parent)].push_back(static_cast<int>(f));
    }
  }
  for (Factor& factor : factors_) {
    if (factor.parent < 0) continue;
    const std::vector<int>& above = factors_[static_cast<std::size_t>(factor.parent)].rows;
    // Both lists ascend.
    auto found = above.begin();
    for (std::size_t i = static_cast<std::size_t>(factor.own); i < factor.rows.size(); ++i) {
      found = std::lower_bound(found, above.end(), factor.rows[i]);
      factor.in_parent.push_back(static_cast<int>(found - above.begin()));
    }
  }
  for (std::size_t t = 0; t < terms.size(); ++t) {
    int first = static_cast<int>(place_.size());
    int node = -1;
    for (const int unknown : terms[t].index) {
      if (unknown < 0 || place_[static_cast<std::size_t>(unknown)] >= first) continue;
      first = place_[static_cast<std::size_t>(unknown)];
      node = node_of_[static_cast<std::size_t>(unknown)];
    }
    if (node < 0) continue;
    factors_[static_cast<std::size_t>(tree.front_of_node[static_cast<std::size_t>(node)])]
        .terms.push_back(static_cast<int>(t));
  }
}

bool Multifrontal::Factorize(const std::vector<SystemTerm>& terms) {
  std::vector<Eigen::MatrixXd> left(factors_.size());  // Of fronts whose parent is to come.
  for (std::size_t f = 0; f < factors_.size(); ++f) {
    if (!FactorizeFront(terms, &left, f)) return false;
  }
  return true;
}

bool Multifrontal::FactorizeFront(const std::vector<SystemTerm>& terms,
                                  std::vector<Eigen::MatrixXd>* left,
                                  std::size_t at) {
  Factor& factor = factors_[at];
  const auto size = Index(factor.rows.size());
  const Eigen::Index own = factor.own;
  Eigen::MatrixXd F = Eigen::MatrixXd::Zero(size, size);
  for (Eigen::Index i = 0; i < size; ++i) {
    local_[static_cast<std::size_t>(factor.rows[static_cast<std::size_t>(i)])] =
        static_cast<int>(i);
  }
  std::vector<int> row;
  for (const int t : factor.terms) {
    const SystemTerm& term = terms[static_cast<std::size_t>(t)];
    row.clear();
    for (const int unknown : term.index) {
      row.push_back(
          unknown < 0
              ? -1
              : local_[static_cast<std::size_t>(place_[static_cast<std::size_t>(unknown)])]);
    }
    for (std::size_t j = 0; j < row.size(); ++j) {
      if (row[j] < 0) continue;
      for (std::size_t i = j; i < row.size(); ++i) {
        if (row[i] < 0) continue;
        F(std::max(row[i], row[j]), std::min(row[i], row[j])) += term.H(Index(i), Index(j));
      }
    }
  }
  for (const int child : children_[at]) {
    const std::vector<int>& to = factors_[static_cast<std::size_t>(child)].in_parent;
    Eigen::MatrixXd U;
    U.swap((*left)[static_cast<std::size_t>(child)]);
    for (std::size_t j = 0; j < to.size(); ++j) {
      for (std::size_t i = j; i < to.size(); ++i) F(to[i], to[j]) += U(Index(i), Index(j));
    }
  }
  Eigen::Ref<Eigen::MatrixXd> F_JJ = F.topLeftCorner(own, own);
  const Eigen::LLT<Eigen::Ref<Eigen::MatrixXd>> llt(F_JJ);
  if (llt.info() != Eigen::Success) return false;
  if (size > own) {
    auto F_SJ = F.bottomLeftCorner(size - own, own);
    llt.matrixL().transpose().solveInPlace<Eigen::OnTheRight>(F_SJ);
    Eigen::MatrixXd& U = (*left)[at];
    U = F.bottomRightCorner(size - own, size - own);
    U.selfadjointView<Eigen::Lower>().rankUpdate(F_SJ, -1.0);
  }
  factor.L = F.leftCols(own);
  return true;
}

Eigen::MatrixXd Multifrontal::Permuted(const Eigen::MatrixXd& b) const {
  Eigen::MatrixXd x(b.rows(), b.cols());
  for (std::size_t i = 0; i < place_.size(); ++i) x.row(place_[i]) = b.row(Index(i));
  return x;
}

Eigen::MatrixXd Multifrontal::Solve(const Eigen::MatrixXd& b) const {
  Eigen::MatrixXd x = Permuted(b);
  for (const Factor& factor : factors_) SolveLower(factor, &x);
  return BackSubstitute(std::move(x));
}

void Multifrontal::SolveLower(const Factor& factor, Eigen::MatrixXd* x) const {
  auto x_J = x->middleRows(factor.rows.front(), factor.own);
  SolveTriangle(factor.L.topRows(factor.own).triangularView<Eigen::Lower>(), x_J);
  const Eigen::Index below = factor.L.rows() - factor.own;
  if (below == 0) return;
  const Eigen::MatrixXd change = factor.L.bottomRows(below) * x_J;
  for (Eigen::Index i = 0; i < below; ++i) {
    x->row(factor.rows[static_cast<std::size_t>(factor.own + i)]) -= change.row(i);
  }
}

// The fronts of some unknowns and all above them, ascending.
std::vector<std::size_t> Multifrontal::FrontsAbove(const std::vector<int>& unknowns) const {
  std::vector<std::size_t> fronts;
  for (const int unknown : unknowns) {
    int front = front_[static_cast<std::size_t>(place_[static_cast<std::size_t>(unknown)])];
    for (; front >= 0; front = factors_[static_cast<std::size_t>(front)].parent) {
      fronts.push_back(static_cast<std::size_t>(front));
    }
  }
  std::sort(fronts.begin(), fronts.end());
  fronts.erase(std::unique(fronts.begin(), fronts.end()), fronts.end());
  return fronts;
}

Eigen::MatrixXd Multifrontal::QuadraticForm(const std::vector<int>& unknowns,
                                            const Eigen::MatrixXd& weights) const {
  Eigen::MatrixXd x = Eigen::MatrixXd::Zero(Index(place_.size()), weights.cols());
  for (std::size_t i = 0; i < unknowns.size(); ++i) {
    x.row(place_[static_cast<std::size_t>(unknowns[i])]) = weights.row(Index(i));
  }
  Eigen::MatrixXd form = Eigen::MatrixXd::Zero(weights.cols(), weights.cols());
  for (const std::size_t front : FrontsAbove(unknowns)) {
    const Factor& factor = factors_[front];
    SolveLower(factor, &x);
    const auto x_J = x.middleRows(factor.rows.front(), factor.own);
    form.noalias() += x_J.transpose() * x_J;
  }
  return form;
}

Eigen::MatrixXd Multifrontal::SolveUpper(const Eigen::MatrixXd& z) const {
  return BackSubstitute(Permuted(z));
}

Eigen::MatrixXd Multifrontal::BackSubstitute(Eigen::MatrixXd x) const {
  Eigen::MatrixXd x_S;
  for (std::size_t f = factors_.size(); f-- > 0;) {
    const Factor& factor = factors_[f];
    auto x_J = x.middleRows(factor.rows.front(), factor.own);
    const Eigen::Index below = factor.L.rows() - factor.own;
    if (below > 0) {
      x_S.resize(below, x.cols());
      for (Eigen::Index i = 0; i < below; ++i) {
        x_S.row(i) = x.row(factor.rows[static_cast<std::size_t>(factor.own + i)]);
      }
      x_J.noalias() -= factor.L.bottomRows(below).transpose() * x_S;
    }
    SolveTriangle(factor.L.topRows(factor.own).triangularView<Eigen::Lower>().transpose(), x_J);
  }
  Eigen::MatrixXd result(x.rows(), x.cols());
  for (std::size_t i = 0; i < place_.size(); ++i) result.row(Index(i)) = x.row(place_[i]);
  return result;
}

void Multifrontal::VisitInverse(const InverseVisitor& visitor) const {
  std::vector<Eigen::MatrixXd> inverse(factors_.size());  // Of fronts with children to come.
  std::vector<std::size_t> to_come(factors_.size());
  for (std::size_t f = 0; f < factors_.size(); ++f) to_come[f] = children_[f].size();
  std::vector<int> unknowns;
  for (std::size_t f = factors_.size(); f-- > 0;) {
    const Factor& factor = factors_[f];
    const auto size = Index(factor.rows.size());
    const Eigen::Index own = factor.own;
    const Eigen::Index below = size - own;
    Eigen::MatrixXd Z(size, size);
    Eigen::MatrixXd inverse_L = Eigen::MatrixXd::Identity(own, own);
    factor.L.topRows(own).triangularView<Eigen::Lower>().solveInPlace(inverse_L);
    Z.topLeftCorner(own, own).noalias() = inverse_L.transpose() * inverse_L;
    if (below > 0) {
      const auto parent = static_cast<std::size_t>(factor.parent);
      const Eigen::MatrixXd& above = inverse[parent];
      Z.bottomRightCorner(below, below) = above(factor.in_parent, factor.in_parent);
      const Eigen::MatrixXd K = factor.L.bottomRows(below) * inverse_L;
      Z.bottomLeftCorner(below, own).noalias() = -(Z.bottomRightCorner(below, below) * K);
      Z.topLeftCorner(own, own).noalias() -= K.transpose() * Z.bottomLeftCorner(below, own);
      Z.topRightCorner(own, below) = Z.bottomLeftCorner(below, own).transpose();
      if (--to_come[parent] == 0) inverse[parent].resize(0, 0);
    }
    unknowns.clear();
    for (const int place : factor.rows) {
      unknowns.push_back(unknown_[static_cast<std::size_t>(place)]);
    }
    visitor(unknowns, factor.own, Z);
    if (to_come[f] > 0) inverse[f] = std::move(Z);
  }
}

double Multifrontal::fill() const {
  return std::accumulate(factors_.begin(), factors_.end(), 0.0, [](double sum, const Factor& f) {
    return sum + static_cast<double>(f.rows.size()) * f.own;
  });
}

}  // namespace shiftmap
