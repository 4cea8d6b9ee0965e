// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/chain_elimination.h"

#include <algorithm>
#include <cstddef>
#include <utility>

namespace shiftmap {
namespace {

constexpr int kPose = kChainRows;
constexpr int kMode = 2;  // Unknowns of a mode.

// A term lies fast where as many of its modes are passed by many chains.
constexpr std::ptrdiff_t kMinPassed = 3;

std::size_t At(std::ptrdiff_t i) { return static_cast<std::size_t>(i); }

// An entry of a matrix of which the lower triangle counts.
double Entry(const Eigen::MatrixXd& H, int i, int j) { return H(std::max(i, j), std::min(i, j)); }

Eigen::MatrixXd Block(const Eigen::MatrixXd& H,
                      const std::vector<int>& rows,
                      const std::vector<int>& columns) {
  Eigen::MatrixXd block(std::ssize(rows), std::ssize(columns));
  for (std::size_t j = 0; j < columns.size(); ++j) {
    for (std::size_t i = 0; i < rows.size(); ++i) {
      block(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)) =
          Entry(H, rows[i], columns[j]);
    }
  }
  return block;
}

constexpr int kNoChain = -1;

// What a term has of a chain: at most two poses, the modes that it passes, and the block of the
// border that is the chain's.
struct Stretch {
  std::vector<int> poses;
  std::vector<int> modes;  // Their first unknowns.
  int chain = kNoChain;
};

Stretch StretchOf(const Border& border, const SystemTerm& term) {
  Stretch stretch;
  for (const int unknown : term.index) {
    if (unknown < 0) continue;
    if (unknown < border.begin) {
      if (unknown % kPose == 0) stretch.poses.push_back(unknown / kPose);
    } else if (unknown < border.end()) {
      stretch.chain = (unknown - border.begin) / border.size;
    } else if ((unknown - border.end()) % kMode == 0) {
      stretch.modes.push_back(unknown);
    }
  }
  return stretch;
}

// The poses at which chains are cut. Nothing if terms have other poses than one or two neighbours.
std::optional<std::vector<int>> FindCuts(int size,
                                         const Border& border,
                                         const std::vector<SystemTerm>& terms,
                                         int min_chains) {
  std::vector<Stretch> stretches;
  std::vector<std::vector<std::size_t>> beside(At(border.begin / kPose));  // Per pose stretches.
  std::vector<int> passed_by(At(size));                                    // Chains, per mode,
  std::vector<int> last_passed_by(At(size), kNoChain);                     // and the last of them.
  for (const SystemTerm& term : terms) {
    const Stretch stretch = StretchOf(border, term);
    const std::vector<int>& poses = stretch.poses;
    if (poses.empty()) continue;
    if (poses.size() > 2 || poses.back() - poses.front() > 1) return std::nullopt;
    for (const int pose : poses) beside[At(pose)].push_back(stretches.size());
    for (const int mode : stretch.modes) {
      if (std::exchange(last_passed_by[At(mode)], stretch.chain) != stretch.chain) {
        ++passed_by[At(mode)];
      }
    }
    stretches.push_back(stretch);
  }
  // What no other chain passes hangs by the chain alone.
  const auto lies_fast = [&](const Stretch& stretch) {
    std::ptrdiff_t passed = 0;
    for (const int mode : stretch.modes) {
      if (passed_by[At(mode)] == 1) return false;
      if (passed_by[At(mode)] >= min_chains) ++passed;
    }
    return passed >= kMinPassed;
  };
  std::vector<int> cuts;
  for (std::size_t pose = 0; pose < beside.size(); ++pose) {
    if (beside[pose].empty() || beside[pose].size() > 2) continue;
    // At the end of a chain nothing is lost.
    if (beside[pose].size() == 1 ||
        (lies_fast(stretches[beside[pose].front()]) && lies_fast(stretches[beside[pose].back()]))) {
      cuts.push_back(static_cast<int>(pose));
    }
  }
  return cuts;
}

}  // namespace

std::optional<ChainElimination> ChainElimination::OfPoses(int size,
                                                          const Border& border,
                                                          const std::vector<SystemTerm>& terms,
                                                          int min_chains) {
  std::optional<std::vector<int>> cuts = FindCuts(size, border, terms, min_chains);
  if (!cuts) return std::nullopt;
  ChainElimination elimination(size, border, *std::move(cuts));
  elimination.MakeParts(terms);
  return elimination;
}

ChainElimination ChainElimination::OfBorder(int size,
                                            const Border& border,
                                            const std::vector<SystemTerm>& terms) {
  ChainElimination elimination(size, border, {});
  elimination.MakeParts(terms);
  return elimination;
}

void ChainElimination::MakeParts(const std::vector<SystemTerm>& terms) {
  for (const int pose : poses_) {
    for (int k = 0; k < kPose; ++k) eliminated_.push_back(kPose * pose + k);
  }
  for (int unknown = border_.begin; unknown < border_.end(); ++unknown) {
    eliminated_.push_back(unknown);
  }
  std::vector<int> row_of(At(size_), -1);  // Among what is eliminated.
  for (std::size_t i = 0; i < eliminated_.size(); ++i) {
    row_of[At(eliminated_[i])] = static_cast<int>(i);
  }
  inner_.assign(At(size_), -1);
  for (int unknown = 0; unknown < size_; ++unknown) {
    if (row_of[At(unknown)] >= 0) continue;
    inner_[At(unknown)] = static_cast<int>(outer_.size());
    outer_.push_back(unknown);
  }
  std::size_t E = 0;
  std::size_t entries = 0;
  for (const SystemTerm& term : terms) {
    TermParts& parts = parts_.emplace_back();
    const auto add = [&](bool poses) {
      for (std::size_t i = 0; i < term.index.size(); ++i) {
        const int unknown = term.index[i];
        if (unknown < 0 || row_of[At(unknown)] < 0 || (unknown < border_.begin) != poses) continue;
        parts.chains.push_back(static_cast<int>(i));
        parts.chain_rows.push_back(row_of[At(unknown)]);
      }
    };
    add(true);
    parts.poses = std::ssize(parts.chains);
    add(false);
    for (std::size_t i = 0; i < term.index.size(); ++i) {
      if (term.index[i] < 0 || RowOf(term.index[i]) < 0) continue;
      parts.others.push_back(static_cast<int>(i));
      parts.other_rows.push_back(RowOf(term.index[i]));
    }
    parts.E = E;
    parts.entries = entries;
    E += parts.others.size() * parts.chains.size();
    entries += parts.others.size() * (parts.others.size() + 1) / 2;
    largest_ = std::max({largest_, parts.others.size(), parts.chains.size()});
  }
  E_.resize(E);
  entries_.resize(entries);
  MakePattern();
}

// The pattern of A, and where in it the entries of each term are.
void ChainElimination::MakePattern() {
  const std::ptrdiff_t count = std::ssize(outer_);
  std::vector<std::vector<std::pair<int, int>>> terms_of(
      outer_.size());  // And places among others.
  for (std::size_t t = 0; t < parts_.size(); ++t) {
    for (std::size_t i = 0; i < parts_[t].other_rows.size(); ++i) {
      terms_of[At(parts_[t].other_rows[i])].emplace_back(static_cast<int>(t), static_cast<int>(i));
    }
  }
  // Entries of a term before column j of its lower triangle.
  const auto before = [](std::size_t size, std::size_t j) { return j * size - j * (j - 1) / 2; };
  std::vector<int> entry_of(outer_.size(), -1);
  std::vector<int> begins(1, 0);
  std::vector<int> rows;
  std::vector<int> in_column;
  for (std::ptrdiff_t column = 0; column < count; ++column) {
    in_column.clear();
    for (const auto& [t, place] : terms_of[At(column)]) {
      for (const int row : parts_[At(t)].other_rows) {
        if (row < column || entry_of[At(row)] >= 0) continue;
        entry_of[At(row)] = 0;
        in_column.push_back(row);
      }
    }
    std::sort(in_column.begin(), in_column.end());
    for (const int row : in_column) {
      entry_of[At(row)] = static_cast<int>(rows.size());
      rows.push_back(row);
    }
    for (const auto& [t, place] : terms_of[At(column)]) {
      const TermParts& parts = parts_[At(t)];
      const std::size_t size = parts.other_rows.size();
      const std::size_t own = At(place);
      for (std::size_t i = 0; i < size; ++i) {
        if (parts.other_rows[i] < column) continue;
        const std::size_t j = std::min(i, own);
        entries_[parts.entries + before(size, j) + (std::max(i, own) - j)] =
            entry_of[At(parts.other_rows[i])];
      }
    }
    for (const int row : in_column) entry_of[At(row)] = -1;
    begins.push_back(static_cast<int>(rows.size()));
  }
  const std::vector<double> values(rows.size(), 0.0);
  A_ = Eigen::Map<const Eigen::SparseMatrix<double>>(
      count, count, std::ssize(rows), begins.data(), rows.data(), values.data());
}

bool ChainElimination::Eliminate(const std::vector<SystemTerm>& terms) {
  A_.coeffs().setZero();
  double* A = A_.valuePtr();
  for (std::size_t t = 0; t < terms.size(); ++t) {
    const Eigen::MatrixXd& H = terms[t].H;
    const TermParts& parts = parts_[t];
    double* E = E_.data() + parts.E;
    for (const int j : parts.chains) {
      for (const int i : parts.others) *E++ = Entry(H, i, j);
    }
    const int* entry = entries_.data() + parts.entries;
    for (std::size_t j = 0; j < parts.others.size(); ++j) {
      for (std::size_t i = j; i < parts.others.size(); ++i) {
        A[*entry++] += Entry(H, parts.others[i], parts.others[j]);
      }
    }
  }
  return FactorizePoses(terms) && FactorizeBorder(terms);
}

std::vector<SystemTerm> ChainElimination::ShapeOfCutTerms() const {
  std::vector<SystemTerm> shape;
  for (const TermParts& parts : parts_) shape.push_back({parts.other_rows, {}});
  return shape;
}

std::optional<std::vector<SystemTerm>> ChainElimination::CutTerms(
    const std::vector<SystemTerm>& terms) const {
  std::vector<SystemTerm> result;
  for (std::size_t t = 0; t < terms.size(); ++t) {
    const Eigen::MatrixXd& H = terms[t].H;
    const TermParts& parts = parts_[t];
    SystemTerm& term =
        result.emplace_back(SystemTerm{parts.other_rows, Block(H, parts.others, parts.others)});
    if (parts.poses == 0) continue;
    // As if they were in no other term.
    const std::vector<int> places(parts.chains.begin(), parts.chains.begin() + parts.poses);
    const Eigen::LLT<Eigen::MatrixXd> poses(Block(H, places, places));
    if (poses.info() != Eigen::Success) return std::nullopt;
    const Eigen::MatrixXd Y = poses.matrixL().solve(Block(H, places, parts.others));
    term.H.selfadjointView<Eigen::Lower>().rankUpdate(Y.transpose(), -1.0);
  }
  return result;
}

ChainElimination::Parts ChainElimination::Split(const Eigen::MatrixXd& x) const {
  return {x(eliminated_, Eigen::all), x(outer_, Eigen::all)};
}

Eigen::MatrixXd ChainElimination::Join(const Parts& parts) const {
  Eigen::MatrixXd x(size_, parts.others.cols());
  x(eliminated_, Eigen::all) = parts.chains;
  x(outer_, Eigen::all) = parts.others;
  return x;
}

void ChainElimination::Reduce(bool held, Parts* b) const {
  SolveChains(held, &b->chains);
  b->others -= ToOthers(b->chains);
}

Eigen::MatrixXd ChainElimination::Times(bool held, const Eigen::MatrixXd& x) const {
  Eigen::MatrixXd chains = FromOthers(x);
  SolveChains(held, &chains);
  return A_.selfadjointView<Eigen::Lower>() * x - ToOthers(chains);
}

void ChainElimination::Complete(bool held, Parts* x) const {
  Eigen::MatrixXd chains = FromOthers(x->others);
  SolveChains(held, &chains);
  x->chains -= chains;
}

// T: block by block along the chains.
bool ChainElimination::FactorizePoses(const std::vector<SystemTerm>& terms) {
  std::vector<Eigen::Matrix3d> own(poses_.size(), Eigen::Matrix3d::Zero());
  std::vector<Eigen::Matrix3d> previous(poses_.size(), Eigen::Matrix3d::Zero());
  for (std::size_t t = 0; t < terms.size(); ++t) {
    const TermParts& parts = parts_[t];
    for (std::size_t a = 0; a < At(parts.poses); ++a) {
      const int row = parts.chain_rows[a];
      for (std::size_t b = 0; b < At(parts.poses); ++b) {
        const int column = parts.chain_rows[b];
        if (row / kPose < column / kPose) continue;
        Eigen::Matrix3d& block = (row / kPose == column / kPose ? own : previous)[At(row / kPose)];
        block(row % kPose, column % kPose) += Entry(terms[t].H, parts.chains[a], parts.chains[b]);
      }
    }
  }
  T_.clear();
  to_previous_ = std::move(previous);
  for (std::size_t i = 0; i < poses_.size(); ++i) {
    if (i > 0) {
      Eigen::Matrix3d& L = to_previous_[i];
      T_[i - 1].matrixL().transpose().solveInPlace<Eigen::OnTheRight>(L);
      own[i].noalias() -= L * L.transpose();
    }
    if (T_.emplace_back(own[i]).info() != Eigen::Success) return false;
  }
  return true;
}

// The border, each block given the others. Precondition: FactorizePoses().
bool ChainElimination::FactorizeBorder(const std::vector<SystemTerm>& terms) {
  const int size = border_.size;
  F_.setZero(PoseRows(), size);
  block_of_.assign(poses_.size(), 0);
  std::vector<Eigen::MatrixXd> own(At(border_.blocks), Eigen::MatrixXd::Zero(size, size));
  for (std::size_t t = 0; t < terms.size(); ++t) {
    const TermParts& parts = parts_[t];
    for (std::size_t b = At(parts.poses); b < parts.chains.size(); ++b) {
      const int unknown = parts.chain_rows[b] - static_cast<int>(PoseRows());
      for (std::size_t a = 0; a < parts.chains.size(); ++a) {
        const double entry = Entry(terms[t].H, parts.chains[a], parts.chains[b]);
        const int row = parts.chain_rows[a];
        if (a < At(parts.poses)) {
          F_(row, unknown % size) += entry;
          block_of_[At(row / kPose)] = unknown / size;
        } else {
          own[At(unknown / size)]((row - PoseRows()) % size, unknown % size) += entry;
        }
      }
    }
  }
  T_inverse_F_ = F_;
  SolvePoses(&T_inverse_F_);
  for (std::size_t i = 0; i < poses_.size(); ++i) {
    const auto row = static_cast<Eigen::Index>(kPose * i);
    own[At(block_of_[i])].noalias() -=
        F_.middleRows<kPose>(row).transpose() * T_inverse_F_.middleRows<kPose>(row);
  }
  border_given_others_.clear();
  for (const Eigen::MatrixXd& block : own) {
    if (border_given_others_.emplace_back(block).info() != Eigen::Success) return false;
  }
  return true;
}

// T⁻¹ in place in the rows of poses.
void ChainElimination::SolvePoses(Eigen::MatrixXd* x) const {
  const auto rows = [x](std::size_t i) {
    return x->middleRows<kPose>(static_cast<Eigen::Index>(i) * kPose);
  };
  for (std::size_t i = 0; i < T_.size(); ++i) {
    if (i > 0) rows(i).noalias() -= to_previous_[i] * rows(i - 1);
    auto x_i = rows(i);
    T_[i].matrixL().solveInPlace(x_i);
  }
  for (std::size_t i = T_.size(); i-- > 0;) {
    if (i + 1 < T_.size()) rows(i).noalias() -= to_previous_[i + 1].transpose() * rows(i + 1);
    auto x_i = rows(i);
    T_[i].matrixU().solveInPlace(x_i);
  }
}

// D⁻¹ in place.
void ChainElimination::SolveChains(bool held, Eigen::MatrixXd* x) const {
  SolvePoses(x);
  auto border = x->bottomRows(border_.end() - border_.begin);
  if (held) {
    border.setZero();
    return;
  }
  const auto block = [&](int number) {
    return border.middleRows(Eigen::Index{border_.size} * number, border_.size);
  };
  for (std::size_t i = 0; i < poses_.size(); ++i) {
    const auto row = static_cast<Eigen::Index>(kPose * i);
    block(block_of_[i]).noalias() -=
        F_.middleRows<kPose>(row).transpose() * x->middleRows<kPose>(row);
  }
  for (int number = 0; number < border_.blocks; ++number) {
    auto x_block = block(number);
    border_given_others_[At(number)].solveInPlace(x_block);
  }
  for (std::size_t i = 0; i < poses_.size(); ++i) {
    const auto row = static_cast<Eigen::Index>(kPose * i);
    x->middleRows<kPose>(row).noalias() -=
        T_inverse_F_.middleRows<kPose>(row) * block(block_of_[i]);
  }
}

// Eᵀ x.
Eigen::MatrixXd ChainElimination::FromOthers(const Eigen::MatrixXd& x) const {
  Eigen::MatrixXd y = Eigen::MatrixXd::Zero(std::ssize(eliminated_), x.cols());
  const auto product = [](const auto& E, const auto& in, auto out) {
    out.noalias() = E.transpose() * in;
  };
  AddProducts(&TermParts::other_rows, &TermParts::chain_rows, product, x, &y);
  return y;
}

// E x.
Eigen::MatrixXd ChainElimination::ToOthers(const Eigen::MatrixXd& x) const {
  Eigen::MatrixXd y = Eigen::MatrixXd::Zero(std::ssize(outer_), x.cols());
  const auto product = [](const auto& E, const auto& in, auto out) { out.noalias() = E * in; };
  AddProducts(&TermParts::chain_rows, &TermParts::other_rows, product, x, &y);
  return y;
}

// Adds what the block of E of each term makes of its rows of x to its rows of y.
template <typename Product>
void ChainElimination::AddProducts(std::vector<int> TermParts::*from,
                                   std::vector<int> TermParts::*to,
                                   const Product& product,
                                   const Eigen::MatrixXd& x,
                                   Eigen::MatrixXd* y) const {
  Eigen::VectorXd in(static_cast<Eigen::Index>(largest_));
  Eigen::VectorXd out(static_cast<Eigen::Index>(largest_));
  for (const TermParts& parts : parts_) {
    if (parts.others.empty() || parts.chains.empty()) continue;
    const Eigen::Map<const Eigen::MatrixXd> E(
        E_.data() + parts.E, std::ssize(parts.others), std::ssize(parts.chains));
    const std::vector<int>& rows = parts.*from;
    const std::vector<int>& to_rows = parts.*to;
    for (Eigen::Index k = 0; k < x.cols(); ++k) {
      for (std::size_t i = 0; i < rows.size(); ++i) {
        in[static_cast<Eigen::Index>(i)] = x(rows[i], k);
      }
      product(E, in.head(std::ssize(rows)), out.head(std::ssize(to_rows)));
      for (std::size_t i = 0; i < to_rows.size(); ++i) {
        (*y)(to_rows[i], k) += out[static_cast<Eigen::Index>(i)];
      }
    }
  }
}

}  // namespace shiftmap
