// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/chain_preconditioner.h"

#include <algorithm>
#include <cstddef>
#include <iterator>
#include <utility>

namespace shiftmap {
namespace {

constexpr int kPose = kChainRows;
constexpr int kMode = 2;  // Unknowns of a mode.

// No chain, and more than one.
constexpr int kNobody = -1;
constexpr int kSeveral = -2;

// A chain is cut between two terms that have as many modes in common, or of which each has as many
// that other chains pass: these say how either lies.
constexpr std::ptrdiff_t kMinCommon = 2;
constexpr std::ptrdiff_t kMinPassed = 3;

std::size_t At(int i) { return static_cast<std::size_t>(i); }

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

// @param a, b  Ascending.
std::ptrdiff_t InCommon(const std::vector<int>& a, const std::vector<int>& b) {
  std::vector<int> common;
  std::set_intersection(a.begin(), a.end(), b.begin(), b.end(), std::back_inserter(common));
  return std::ssize(common);
}

}  // namespace

void ChainPreconditioner::Forget() {
  has_shape_ = false;
  has_factor_ = false;
}

// Which poses are cut. False if terms have other poses than one or two neighbours.
bool ChainPreconditioner::FindCuts(const std::vector<SystemTerm>& terms) {
  std::vector<Stretch> stretches;
  std::vector<std::vector<std::size_t>> beside(At(border_.begin / kPose));  // Per pose stretches.
  std::vector<int> passed_by(At(size_), kNobody);                           // Per mode.
  for (const SystemTerm& term : terms) {
    const Stretch stretch = StretchOf(term);
    const std::vector<int>& poses = stretch.poses;
    if (poses.empty()) continue;
    if (poses.size() > 2 || poses.back() - poses.front() > 1) return false;
    for (const int pose : poses) beside[At(pose)].push_back(stretches.size());
    for (const int mode : stretch.modes) {
      int& chain = passed_by[At(mode)];
      chain = chain == kNobody || chain == stretch.chain ? stretch.chain : kSeveral;
    }
    stretches.push_back(stretch);
  }
  const auto lies_fast = [&](const Stretch& stretch) {
    return std::count_if(stretch.modes.begin(), stretch.modes.end(), [&](int mode) {
             return passed_by[At(mode)] == kSeveral;
           }) >= kMinPassed;
  };
  cut_.assign(beside.size(), -1);
  poses_.clear();
  for (std::size_t pose = 0; pose < beside.size(); ++pose) {
    if (beside[pose].empty() || beside[pose].size() > 2) continue;
    if (!stays_.empty() && stays_[pose]) continue;
    const Stretch& before = stretches[beside[pose].front()];
    const Stretch& after = stretches[beside[pose].back()];
    // At the end of a chain nothing is lost.
    if (beside[pose].size() == 2 && InCommon(before.modes, after.modes) < kMinCommon &&
        !(lies_fast(before) && lies_fast(after))) {
      continue;
    }
    cut_[pose] = static_cast<int>(poses_.size());
    poses_.push_back(static_cast<int>(pose));
  }
  return true;
}

// A term's part of a chain.
ChainPreconditioner::Stretch ChainPreconditioner::StretchOf(const SystemTerm& term) const {
  Stretch stretch;
  for (const int unknown : term.index) {
    if (unknown < 0) continue;
    if (unknown < border_.begin) {
      if (unknown % kPose == 0) stretch.poses.push_back(unknown / kPose);
    } else if (unknown < border_.end()) {
      stretch.chain = (unknown - border_.begin) / border_.size;
    } else if ((unknown - border_.end()) % kMode == 0) {
      stretch.modes.push_back(unknown);
    }
  }
  std::sort(stretch.modes.begin(), stretch.modes.end());
  return stretch;
}

bool ChainPreconditioner::Shape(const std::vector<SystemTerm>& terms) {
  if (!FindCuts(terms)) return false;
  inner_.assign(At(size_), -1);
  outer_.clear();
  for (int unknown = 0; unknown < size_; ++unknown) {
    const bool is_cut = unknown < border_.begin && cut_[At(unknown / kPose)] >= 0;
    const bool held = unknown >= border_.begin && unknown < border_.end();
    if (is_cut || held) continue;
    inner_[At(unknown)] = static_cast<int>(outer_.size());
    outer_.push_back(unknown);
  }
  splits_.assign(terms.size(), {});
  terms_.assign(terms.size(), {});
  for (std::size_t t = 0; t < terms.size(); ++t) {
    const std::vector<int>& index = terms[t].index;
    for (std::size_t i = 0; i < index.size(); ++i) {
      if (index[i] < 0) continue;
      const auto place = static_cast<int>(i);
      if (const int row = inner_[At(index[i])]; row >= 0) {
        splits_[t].others.push_back(place);
        terms_[t].index.push_back(row);
      } else if (index[i] < border_.begin) {
        splits_[t].poses.push_back(place);
        splits_[t].pose_rows.push_back(kPose * cut_[At(index[i] / kPose)] + index[i] % kPose);
      }
    }
  }
  factor_ = std::make_unique<Multifrontal>(static_cast<int>(outer_.size()), terms_);
  return true;
}

bool ChainPreconditioner::Factorize(const std::vector<SystemTerm>& terms) {
  has_factor_ = false;
  if (!has_shape_) has_shape_ = Shape(terms);
  if (!has_shape_) return false;
  for (std::size_t t = 0; t < terms.size(); ++t) {
    if (!Cut(terms[t], t)) return false;
  }
  has_factor_ = FactorizeChains(terms) && factor_->Factorize(terms_);
  return has_factor_;
}

// A term without its poses, as if they were in no other.
bool ChainPreconditioner::Cut(const SystemTerm& term, std::size_t at) {
  Split& split = splits_[at];
  Eigen::MatrixXd& H = terms_[at].H;
  H = Block(term.H, split.others, split.others);
  if (split.poses.empty()) return true;
  split.B = Block(term.H, split.others, split.poses);
  const Eigen::LLT<Eigen::MatrixXd> poses(Block(term.H, split.poses, split.poses));
  if (poses.info() != Eigen::Success) return false;
  const Eigen::MatrixXd Y = poses.matrixL().solve(split.B.transpose());
  H.selfadjointView<Eigen::Lower>().rankUpdate(Y.transpose(), -1.0);
  return true;
}

// T as it is, not cut: block by block along the chains.
bool ChainPreconditioner::FactorizeChains(const std::vector<SystemTerm>& terms) {
  std::vector<Eigen::Matrix3d> own(poses_.size(), Eigen::Matrix3d::Zero());
  std::vector<Eigen::Matrix3d> previous(poses_.size(), Eigen::Matrix3d::Zero());
  for (std::size_t t = 0; t < terms.size(); ++t) {
    const Split& split = splits_[t];
    for (std::size_t a = 0; a < split.poses.size(); ++a) {
      const int row = split.pose_rows[a];
      for (std::size_t b = 0; b < split.poses.size(); ++b) {
        const int column = split.pose_rows[b];
        if (row / kPose < column / kPose) continue;
        Eigen::Matrix3d& block = (row / kPose == column / kPose ? own : previous)[At(row / kPose)];
        block(row % kPose, column % kPose) += Entry(terms[t].H, split.poses[a], split.poses[b]);
      }
    }
  }
  chain_.clear();
  to_previous_ = std::move(previous);
  for (std::size_t i = 0; i < poses_.size(); ++i) {
    if (i > 0) {
      Eigen::Matrix3d& F = to_previous_[i];
      chain_[i - 1].matrixL().transpose().solveInPlace<Eigen::OnTheRight>(F);
      own[i].noalias() -= F * F.transpose();
    }
    if (chain_.emplace_back(own[i]).info() != Eigen::Success) return false;
  }
  return true;
}

// T⁻¹ in place: three rows per pose that is cut.
void ChainPreconditioner::SolveChains(Eigen::MatrixXd* x) const {
  const auto rows = [x](std::size_t i) {
    return x->middleRows<kPose>(static_cast<Eigen::Index>(i) * kPose);
  };
  for (std::size_t i = 0; i < chain_.size(); ++i) {
    if (i > 0) rows(i).noalias() -= to_previous_[i] * rows(i - 1);
    auto x_i = rows(i);
    chain_[i].matrixL().solveInPlace(x_i);
  }
  for (std::size_t i = chain_.size(); i-- > 0;) {
    if (i + 1 < chain_.size()) rows(i).noalias() -= to_previous_[i + 1].transpose() * rows(i + 1);
    auto x_i = rows(i);
    chain_[i].matrixU().solveInPlace(x_i);
  }
}

Eigen::MatrixXd ChainPreconditioner::Inner(const Eigen::MatrixXd& x) const {
  Eigen::MatrixXd inner(std::ssize(outer_), x.cols());
  for (std::size_t i = 0; i < outer_.size(); ++i) {
    inner.row(static_cast<Eigen::Index>(i)) = x.row(outer_[i]);
  }
  return inner;
}

Eigen::MatrixXd ChainPreconditioner::Solve(const Eigen::MatrixXd& b) const {
  Eigen::MatrixXd poses(kPose * std::ssize(poses_), b.cols());
  for (std::size_t i = 0; i < poses_.size(); ++i) {
    poses.middleRows<kPose>(static_cast<Eigen::Index>(kPose * i)) =
        b.middleRows<kPose>(Eigen::Index{kPose} * poses_[i]);
  }
  SolveChains(&poses);
  Eigen::MatrixXd inner = Inner(b);
  for (std::size_t t = 0; t < splits_.size(); ++t) {
    const Split& split = splits_[t];
    if (split.poses.empty()) continue;
    inner(terms_[t].index, Eigen::all) -= split.B * poses(split.pose_rows, Eigen::all);
  }
  inner = factor_->Solve(inner);
  Eigen::MatrixXd change = Eigen::MatrixXd::Zero(poses.rows(), poses.cols());
  for (std::size_t t = 0; t < splits_.size(); ++t) {
    const Split& split = splits_[t];
    if (split.poses.empty()) continue;
    change(split.pose_rows, Eigen::all) += split.B.transpose() * inner(terms_[t].index, Eigen::all);
  }
  SolveChains(&change);
  poses -= change;
  Eigen::MatrixXd x = Outer(inner);
  for (std::size_t i = 0; i < poses_.size(); ++i) {
    x.middleRows<kPose>(Eigen::Index{kPose} * poses_[i]) =
        poses.middleRows<kPose>(static_cast<Eigen::Index>(kPose * i));
  }
  return x;
}

// Zero where it is not of M.
Eigen::MatrixXd ChainPreconditioner::Outer(const Eigen::MatrixXd& inner) const {
  Eigen::MatrixXd x = Eigen::MatrixXd::Zero(size_, inner.cols());
  for (std::size_t i = 0; i < outer_.size(); ++i) {
    x.row(outer_[i]) = inner.row(static_cast<Eigen::Index>(i));
  }
  return x;
}

Eigen::MatrixXd ChainPreconditioner::SolveUpper(const Eigen::MatrixXd& z) const {
  return Outer(factor_->SolveUpper(Inner(z)));
}

Eigen::MatrixXd ChainPreconditioner::QuadraticForm(const std::vector<int>& index,
                                                   const Eigen::MatrixXd& weights) const {
  std::vector<int> rows;
  std::vector<int> unknowns;
  for (std::size_t i = 0; i < index.size(); ++i) {
    if (inner_[At(index[i])] < 0) continue;
    rows.push_back(static_cast<int>(i));
    unknowns.push_back(inner_[At(index[i])]);
  }
  return factor_->QuadraticForm(unknowns, weights(rows, Eigen::all));
}

void ChainPreconditioner::VisitInverse(const InverseVisitor& visitor) const {
  std::vector<int> unknowns;
  factor_->VisitInverse([&](const std::vector<int>& rows, int own, const Eigen::MatrixXd& Z) {
    unknowns.clear();
    for (const int row : rows) unknowns.push_back(outer_[At(row)]);
    visitor(unknowns, own, Z);
  });
}

}  // namespace shiftmap
