// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/multifrontal.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <boost/container/small_vector.hpp>
#include <utility>

#include "mapper/parallel.h"

namespace shiftmap {
namespace {

Eigen::Index Index(std::size_t i) { return static_cast<Eigen::Index>(i); }

std::size_t At(int i) { return static_cast<std::size_t>(i); }

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

// Consecutive unknowns that every term has together or not at all are one node.
class MultifrontalShape::Nodes {
 public:
  Nodes(int size, const std::vector<SystemTerm>& terms) {
    const std::vector<bool> begins = Begins(size, terms);
    for (int i = 0; i < size; ++i) {
      if (i == 0 || begins[At(i)]) begin_.push_back(i);
      node_of_.push_back(static_cast<int>(begin_.size()) - 1);
    }
    begin_.push_back(size);
    for (std::size_t n = 0; n + 1 < begin_.size(); ++n) {
      sizes_.push_back(begin_[n + 1] - begin_[n]);
    }
  }

  const std::vector<int>& sizes() const { return sizes_; }
  int SizeOf(int node) const { return sizes_[At(node)]; }
  int FirstOf(int node) const { return begin_[At(node)]; }

  // The nodes of each term.
  std::vector<std::vector<int>> CliquesOf(const std::vector<SystemTerm>& terms) const {
    std::vector<std::vector<int>> cliques;
    for (const SystemTerm& term : terms) {
      std::vector<int>& nodes = cliques.emplace_back();
      for (const int unknown : term.index) {
        if (unknown < 0) continue;
        const int node = node_of_[At(unknown)];
        if (FirstOf(node) == unknown) nodes.push_back(node);
      }
    }
    return cliques;
  }

 private:
  // Where some term has an unknown but not the one before it, or the other way around.
  static std::vector<bool> Begins(int size, const std::vector<SystemTerm>& terms) {
    std::vector<bool> begins(At(size) + 1);
    std::vector<int> mark(At(size), -1);
    for (std::size_t t = 0; t < terms.size(); ++t) {
      const auto term = static_cast<int>(t);
      const auto has = [&](int unknown) {
        return unknown >= 0 && unknown < size && mark[At(unknown)] == term;
      };
      for (const int unknown : terms[t].index) {
        if (unknown >= 0) mark[At(unknown)] = term;
      }
      for (const int unknown : terms[t].index) {
        if (unknown < 0) continue;
        if (!has(unknown - 1)) begins[At(unknown)] = true;
        if (!has(unknown + 1)) begins[At(unknown) + 1] = true;
      }
    }
    return begins;
  }

  std::vector<int> node_of_;  // Per unknown.
  std::vector<int> begin_;    // Per node its first unknown, and the number of unknowns.
  std::vector<int> sizes_;
};

MultifrontalShape::MultifrontalShape(int size, const std::vector<SystemTerm>& terms) {
  const Nodes nodes(size, terms);
  const EliminationTree tree = MakeEliminationTree(nodes.sizes(), nodes.CliquesOf(terms));
  position_.resize(At(size));
  OrderUnknowns(nodes, tree);
  MakeFronts(nodes, tree);
  LinkToParents();
  AssignTerms(terms);
  CountProducts();
}

void MultifrontalShape::OrderUnknowns(const Nodes& nodes, const EliminationTree& tree) {
  for (std::size_t f = 0; f < tree.fronts.size(); ++f) {
    for (int i = 0; i < tree.fronts[f].own; ++i) {
      const int node = tree.fronts[f].rows[At(i)];
      for (int k = 0; k < nodes.SizeOf(node); ++k) {
        const int unknown = nodes.FirstOf(node) + k;
        position_[At(unknown)] = static_cast<int>(unknowns_.size());
        unknowns_.push_back(unknown);
        front_of_position_.push_back(static_cast<int>(f));
      }
    }
  }
}

void MultifrontalShape::MakeFronts(const Nodes& nodes, const EliminationTree& tree) {
  for (const Front& of_nodes : tree.fronts) {
    FrontShape& front = fronts_.emplace_back();
    front.parent = of_nodes.parent;
    for (std::size_t i = 0; i < of_nodes.rows.size(); ++i) {
      const int node = of_nodes.rows[i];
      const int first = PositionOf(nodes.FirstOf(node));
      for (int k = 0; k < nodes.SizeOf(node); ++k) front.rows.push_back(first + k);
      if (static_cast<int>(i) < of_nodes.own) front.own += nodes.SizeOf(node);
    }
  }
}

void MultifrontalShape::LinkToParents() {
  for (std::size_t f = 0; f < fronts_.size(); ++f) {
    FrontShape& front = fronts_[f];
    if (front.parent < 0) continue;
    FrontShape& parent = fronts_[At(front.parent)];
    parent.children.push_back(static_cast<int>(f));
    // Both lists ascend.
    auto found = parent.rows.begin();
    for (std::size_t i = At(front.own); i < front.rows.size(); ++i) {
      found = std::lower_bound(found, parent.rows.end(), front.rows[i]);
      front.row_in_parent.push_back(static_cast<int>(found - parent.rows.begin()));
    }
  }
}

// A term goes to the front that eliminates the first of its unknowns.
void MultifrontalShape::AssignTerms(const std::vector<SystemTerm>& terms) {
  for (std::size_t t = 0; t < terms.size(); ++t) {
    auto first = static_cast<int>(position_.size());
    for (const int unknown : terms[t].index) {
      if (unknown >= 0) first = std::min(first, PositionOf(unknown));
    }
    if (At(first) == position_.size()) continue;
    fronts_[At(front_of_position_[At(first)])].terms.push_back(static_cast<int>(t));
  }
}

void MultifrontalShape::CountProducts() {
  std::vector<double> of_subtree;  // Per front, of a factorization.
  for (const FrontShape& front : fronts_) {
    const double own = front.own;
    const double below = static_cast<double>(front.rows.size()) - own;
    const double products = own * (own * own / 6.0 + own * below / 2.0 + below * below / 2.0);
    factor_products_ += products;
    solve_products_ += own * (own + 2.0 * below);
    of_subtree.push_back(products);
    for (const int child : front.children) of_subtree.back() += of_subtree[At(child)];
  }
  Divide(of_subtree);
}

// The largest subtrees that take no more than a small share of all.
void MultifrontalShape::Divide(const std::vector<double>& products) {
  constexpr double kShare = 1.0 / 32.0;
  std::vector<int> subtree(fronts_.size(), -1);  // Of each front.
  for (std::size_t f = fronts_.size(); f-- > 0;) {
    const int parent = fronts_[f].parent;
    if (parent >= 0 && subtree[At(parent)] >= 0) {
      subtree[f] = subtree[At(parent)];
    } else if (products[f] <= kShare * factor_products_) {
      subtree[f] = static_cast<int>(subtrees_.size());
      subtrees_.emplace_back();
    }
  }
  for (std::size_t f = 0; f < fronts_.size(); ++f) {
    (subtree[f] < 0 ? above_subtrees_ : subtrees_[At(subtree[f])]).push_back(f);
  }
}

std::vector<std::size_t> MultifrontalShape::FrontsAbove(const std::vector<int>& unknowns) const {
  std::vector<std::size_t> fronts;
  for (const int unknown : unknowns) {
    int front = front_of_position_[At(PositionOf(unknown))];
    for (; front >= 0; front = fronts_[At(front)].parent) fronts.push_back(At(front));
  }
  std::sort(fronts.begin(), fronts.end());
  fronts.erase(std::unique(fronts.begin(), fronts.end()), fronts.end());
  return fronts;
}

// Factors fronts, children before parents: subtrees of the elimination tree side by side, then the
// fronts above them, of which each is divided.
class MultifrontalFactor::Factorization {
 public:
  Factorization(const std::vector<SystemTerm>& terms, int threads, MultifrontalFactor* factor)
      : shape_(*factor->shape_),
        terms_(terms),
        threads_(threads),
        L_(factor->L_),
        updates_(shape_.fronts().size()) {
    L_.resize(shape_.fronts().size());
  }

  // False if a front is not positive definite.
  bool Run() {
    const std::vector<std::vector<std::size_t>>& subtrees = shape_.subtrees();
    std::vector<char> definite(subtrees.size());
    ForEachIndex(
        subtrees.size(), threads_, [&](std::size_t i) { definite[i] = Factorize(subtrees[i], 1); });
    return std::all_of(definite.begin(), definite.end(), [](char each) { return each; }) &&
           Factorize(shape_.above_subtrees(), threads_);
  }

 private:
  bool Factorize(const std::vector<std::size_t>& fronts, int threads) {
    std::vector<int> local(shape_.unknowns().size());
    return std::all_of(fronts.begin(), fronts.end(), [&](std::size_t front) {
      return Eliminate(front, Assemble(front, &local), threads);
    });
  }

  // The sum of a front's terms and of its children's update matrices.
  // @param local  Scratch: per position its row in the front.
  Eigen::MatrixXd Assemble(std::size_t at, std::vector<int>* local) {
    const MultifrontalShape::FrontShape& front = shape_.fronts()[at];
    const Eigen::Index size = std::ssize(front.rows);
    Eigen::MatrixXd F = Eigen::MatrixXd::Zero(size, size);
    for (Eigen::Index i = 0; i < size; ++i) {
      (*local)[At(front.rows[static_cast<std::size_t>(i)])] = static_cast<int>(i);
    }
    for (const int term : front.terms) AddTerm(terms_[At(term)], *local, &F);
    for (const int child : front.children) {
      const std::vector<int>& to = shape_.fronts()[At(child)].row_in_parent;
      Eigen::MatrixXd U;
      U.swap(updates_[At(child)]);
      for (std::size_t j = 0; j < to.size(); ++j) {
        for (std::size_t i = j; i < to.size(); ++i) F(to[i], to[j]) += U(Index(i), Index(j));
      }
    }
    return F;
  }

  void AddTerm(const SystemTerm& term, const std::vector<int>& local, Eigen::MatrixXd* F) const {
    boost::container::small_vector<int, 64> row;
    for (const int unknown : term.index) {
      row.push_back(unknown < 0 ? -1 : local[At(shape_.PositionOf(unknown))]);
    }
    for (std::size_t j = 0; j < row.size(); ++j) {
      if (row[j] < 0) continue;
      for (std::size_t i = j; i < row.size(); ++i) {
        if (row[i] < 0) continue;
        (*F)(std::max(row[i], row[j]), std::min(row[i], row[j])) += term.H(Index(i), Index(j));
      }
    }
  }

  bool Eliminate(std::size_t at, Eigen::MatrixXd F, int threads) {
    const Eigen::Index own = shape_.fronts()[at].own;
    const Eigen::Index below = F.rows() - own;
    for (Eigen::Index k = 0; k < own; k += kPanel) {
      if (!EliminatePanel(k, std::min(kPanel, own - k), threads, &F)) return false;
    }
    if (below > 0) updates_[at] = F.bottomRightCorner(below, below);
    L_[at] = F.leftCols(own);
    return true;
  }

  // Eliminates `width` unknowns from `first` on: their columns become the factor's, those after
  // them the update.
  static bool EliminatePanel(Eigen::Index first,
                             Eigen::Index width,
                             int threads,
                             Eigen::MatrixXd* F) {
    Eigen::Ref<Eigen::MatrixXd> F_JJ = F->block(first, first, width, width);
    const Eigen::LLT<Eigen::Ref<Eigen::MatrixXd>> llt(F_JJ);
    if (llt.info() != Eigen::Success) return false;
    const Eigen::Index next = first + width;
    const Eigen::Index below = F->rows() - next;
    const auto blocks = static_cast<std::size_t>((below + kPanel - 1) / kPanel);
    const auto begin = [&](std::size_t block) { return next + Index(block) * kPanel; };
    const auto size = [&](std::size_t block) { return std::min(kPanel, F->rows() - begin(block)); };
    ForEachIndex(blocks, threads, [&](std::size_t i) {
      auto L_i = F->block(begin(i), first, size(i), width);
      llt.matrixL().transpose().solveInPlace<Eigen::OnTheRight>(L_i);
    });
    ForEachIndex(blocks, threads, [&](std::size_t j) {
      const auto L_j = F->block(begin(j), first, size(j), width);
      F->block(begin(j), begin(j), size(j), size(j))
          .selfadjointView<Eigen::Lower>()
          .rankUpdate(L_j, -1.0);
      const Eigen::Index after = F->rows() - begin(j) - size(j);
      F->block(begin(j) + size(j), begin(j), after, size(j)).noalias() -=
          F->block(begin(j) + size(j), first, after, width) * L_j.transpose();
    });
    return true;
  }

  // Unknowns that are eliminated from the rest of a front at once.
  static constexpr Eigen::Index kPanel = 192;

  const MultifrontalShape& shape_;
  const std::vector<SystemTerm>& terms_;
  const int threads_;
  std::vector<Eigen::MatrixXd>& L_;
  std::vector<Eigen::MatrixXd> updates_;  // Of fronts whose parent is to come.
};

std::shared_ptr<const MultifrontalFactor> MultifrontalFactor::Of(
    std::shared_ptr<const MultifrontalShape> shape,
    const std::vector<SystemTerm>& terms,
    int threads) {
  const std::shared_ptr<MultifrontalFactor> factor(new MultifrontalFactor(std::move(shape)));
  if (!Factorization(terms, threads, factor.get()).Run()) return nullptr;
  return factor;
}

Eigen::MatrixXd MultifrontalFactor::Permuted(const Eigen::MatrixXd& b) const {
  const std::vector<int>& unknowns = shape_->unknowns();
  Eigen::MatrixXd x(b.rows(), b.cols());
  for (std::size_t i = 0; i < unknowns.size(); ++i) x.row(Index(i)) = b.row(unknowns[i]);
  return x;
}

Eigen::MatrixXd MultifrontalFactor::Solve(const Eigen::MatrixXd& b) const {
  Eigen::MatrixXd x = Permuted(b);
  for (std::size_t front = 0; front < L_.size(); ++front) SolveLower(front, &x);
  return BackSubstitute(std::move(x));
}

Eigen::MatrixXd MultifrontalFactor::SolveUpper(const Eigen::MatrixXd& z) const {
  return BackSubstitute(Permuted(z));
}

void MultifrontalFactor::SolveLower(std::size_t at, Eigen::MatrixXd* x) const {
  const MultifrontalShape::FrontShape& front = shape_->fronts()[at];
  const Eigen::MatrixXd& L = L_[at];
  auto x_J = x->middleRows(front.rows.front(), front.own);
  SolveTriangle(L.topRows(front.own).triangularView<Eigen::Lower>(), x_J);
  const Eigen::Index below = L.rows() - front.own;
  if (below == 0) return;
  const Eigen::MatrixXd change = L.bottomRows(below) * x_J;
  for (Eigen::Index i = 0; i < below; ++i) {
    x->row(front.rows[static_cast<std::size_t>(front.own + i)]) -= change.row(i);
  }
}

Eigen::MatrixXd MultifrontalFactor::QuadraticForm(const std::vector<int>& unknowns,
                                                  const Eigen::MatrixXd& weights) const {
  Eigen::MatrixXd x = Eigen::MatrixXd::Zero(size(), weights.cols());
  for (std::size_t i = 0; i < unknowns.size(); ++i) {
    x.row(shape_->PositionOf(unknowns[i])) = weights.row(Index(i));
  }
  Eigen::MatrixXd form = Eigen::MatrixXd::Zero(weights.cols(), weights.cols());
  for (const std::size_t at : shape_->FrontsAbove(unknowns)) {
    SolveLower(at, &x);
    const MultifrontalShape::FrontShape& front = shape_->fronts()[at];
    const auto x_J = x.middleRows(front.rows.front(), front.own);
    form.noalias() += x_J.transpose() * x_J;
  }
  return form;
}

Eigen::MatrixXd MultifrontalFactor::BackSubstitute(Eigen::MatrixXd x) const {
  Eigen::MatrixXd x_S;
  for (std::size_t f = L_.size(); f-- > 0;) {
    const MultifrontalShape::FrontShape& front = shape_->fronts()[f];
    const Eigen::MatrixXd& L = L_[f];
    auto x_J = x.middleRows(front.rows.front(), front.own);
    const Eigen::Index below = L.rows() - front.own;
    if (below > 0) {
      x_S.resize(below, x.cols());
      for (Eigen::Index i = 0; i < below; ++i) {
        x_S.row(i) = x.row(front.rows[static_cast<std::size_t>(front.own + i)]);
      }
      x_J.noalias() -= L.bottomRows(below).transpose() * x_S;
    }
    SolveTriangle(L.topRows(front.own).triangularView<Eigen::Lower>().transpose(), x_J);
  }
  const std::vector<int>& unknowns = shape_->unknowns();
  Eigen::MatrixXd result(x.rows(), x.cols());
  for (std::size_t i = 0; i < unknowns.size(); ++i) result.row(unknowns[i]) = x.row(Index(i));
  return result;
}

void MultifrontalFactor::VisitInverse(const InverseVisitor& visitor) const {
  const std::vector<MultifrontalShape::FrontShape>& fronts = shape_->fronts();
  std::vector<Eigen::MatrixXd> inverse(fronts.size());  // Of fronts with children to come.
  std::vector<std::size_t> to_come(fronts.size());
  for (std::size_t f = 0; f < fronts.size(); ++f) to_come[f] = fronts[f].children.size();
  std::vector<int> unknowns;
  for (std::size_t f = fronts.size(); f-- > 0;) {
    const MultifrontalShape::FrontShape& front = fronts[f];
    const Eigen::MatrixXd& L = L_[f];
    const Eigen::Index size = std::ssize(front.rows);
    const Eigen::Index own = front.own;
    const Eigen::Index below = size - own;
    Eigen::MatrixXd Z(size, size);
    Eigen::MatrixXd inverse_L = Eigen::MatrixXd::Identity(own, own);
    L.topRows(own).triangularView<Eigen::Lower>().solveInPlace(inverse_L);
    Z.topLeftCorner(own, own).noalias() = inverse_L.transpose() * inverse_L;
    if (below > 0) {
      const std::size_t parent = At(front.parent);
      const Eigen::MatrixXd& above = inverse[parent];
      Z.bottomRightCorner(below, below) = above(front.row_in_parent, front.row_in_parent);
      const Eigen::MatrixXd K = L.bottomRows(below) * inverse_L;
      Z.bottomLeftCorner(below, own).noalias() = -(Z.bottomRightCorner(below, below) * K);
      Z.topLeftCorner(own, own).noalias() -= K.transpose() * Z.bottomLeftCorner(below, own);
      Z.topRightCorner(own, below) = Z.bottomLeftCorner(below, own).transpose();
      if (--to_come[parent] == 0) inverse[parent].resize(0, 0);
    }
    unknowns.clear();
    for (const int position : front.rows) unknowns.push_back(shape_->unknowns()[At(position)]);
    visitor(unknowns, front.own, Z);
    if (to_come[f] > 0) inverse[f] = std::move(Z);
  }
}

}  // namespace shiftmap
