// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/reduced_system.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace shiftmap {
namespace {

// Up to here a dense factor is faster than ordering a sparse one.
constexpr int kMaxDense = 400;

// Conjugate gradients: relative error of the solution in the norm of the factor. A step to the
// minimum of the loss leaves more than that.
constexpr double kTolerance = 1e-3;

// They may take this share of the time of a factorization. A product of a solve waits for memory
// and costs kSolveCost times a product of a factorization.
constexpr double kMaxShare = 0.5;
constexpr double kSolveCost = 5.0;

// After this share of their iterations the error has to fall as fast as they need to converge.
constexpr double kGrace = 1.0 / 3.0;

}  // namespace

ReducedSystem::ReducedSystem(int size, int threads)
    : threads_(threads), b_(Eigen::VectorXd::Zero(size)) {
  if (dense()) H_.setZero(size, size);
}

bool ReducedSystem::dense() const { return b_.size() <= kMaxDense; }

void ReducedSystem::Clear() {
  b_.setZero();
  H_.setZero();
  added_ = 0;
}

void ReducedSystem::Add(const std::vector<int>& index,
                        Eigen::MatrixXd H,
                        const Eigen::VectorXd& b) {
  for (std::size_t j = 0; j < index.size(); ++j) {
    if (index[j] < 0) continue;
    b_[index[j]] += b[static_cast<Eigen::Index>(j)];
    if (!dense()) continue;
    for (std::size_t i = j; i < index.size(); ++i) {
      if (index[i] < 0) continue;
      H_(std::max(index[i], index[j]), std::min(index[i], index[j])) +=
          H(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j));
    }
  }
  if (dense()) return;
  if (added_ == terms_.size()) {
    terms_.push_back({index, std::move(H)});
    ForgetShape();
  } else {
    SystemTerm& term = terms_[added_];
    if (term.index != index) {
      term.index = index;
      ForgetShape();
    }
    term.H = std::move(H);
  }
  ++added_;
}

void ReducedSystem::ForgetShape() {
  shape_.reset();
  factor_.reset();
}

std::shared_ptr<const CholeskyFactor> ReducedSystem::Factorize() {
  if (dense()) return MakeDenseFactor(H_);
  if (added_ < terms_.size()) {
    terms_.resize(added_);
    ForgetShape();
  }
  if (!shape_) shape_ = std::make_shared<MultifrontalShape>(size(), terms_);
  factor_.reset();
  factor_ = MultifrontalFactor::Of(shape_, terms_, threads_);
  for (SystemTerm& term : terms_) term.H.resize(0, 0);
  return factor_;
}

std::optional<Eigen::VectorXd> ReducedSystem::Solve() {
  if (factor_ && added_ == terms_.size()) {
    if (std::optional<Eigen::VectorXd> x = ConjugateGradients()) return x;
  }
  const std::shared_ptr<const CholeskyFactor> factor = Factorize();
  if (!factor) return std::nullopt;
  return factor->Solve(b_);
}

// Hestenes and Stiefel, preconditioned. Nothing if it does not converge in time.
std::optional<Eigen::VectorXd> ReducedSystem::ConjugateGradients() const {
  const double max_iterations =
      kMaxShare * shape_->factor_products() / (kSolveCost * shape_->solve_products());
  Eigen::VectorXd x = Eigen::VectorXd::Zero(b_.size());
  Eigen::VectorXd residual = b_;
  Eigen::VectorXd direction = factor_->Solve(residual);
  double squared = residual.dot(direction);
  double least = squared;
  const double first = squared;
  for (int i = 0; !(squared <= kTolerance * kTolerance * first); ++i) {
    const double limit = first * std::pow(kTolerance, 2.0 * (i / max_iterations - kGrace));
    if (i + 1 > max_iterations || !(least <= limit)) return std::nullopt;
    const Eigen::VectorXd image = Times(terms_, direction);
    const double curvature = direction.dot(image);
    if (!(curvature > 0.0)) return std::nullopt;
    const double length = squared / curvature;
    x += length * direction;
    residual -= length * image;
    const Eigen::VectorXd preconditioned = factor_->Solve(residual);
    const double next = residual.dot(preconditioned);
    direction = preconditioned + next / squared * direction;
    squared = next;
    least = std::min(least, squared);
  }
  return x;
}

}  // namespace shiftmap
