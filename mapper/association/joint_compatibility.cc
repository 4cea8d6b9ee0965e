// SPDX-License-Identifier: Apache-2.0
#include "mapper/association/joint_compatibility.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <set>

#include "mapstore/geometry/covariance.h"
#include "proto/core/check.h"

namespace shiftmap {
namespace {

double IndividualDistance(const CompatibilityProblem& problem, int candidate) {
  const Eigen::Index row = Eigen::Index{2} * candidate;
  return SquaredMahalanobis(problem.nu.segment<2>(row), problem.covariance.block<2, 2>(row, row));
}

void CheckProblem(const CompatibilityProblem& problem) {
  const auto rows = static_cast<Eigen::Index>(2 * problem.candidates.size());
  SHIFTMAP_CHECK(problem.nu.size() == rows && problem.covariance.rows() == rows &&
                     problem.covariance.cols() == rows,
                 "{} candidates, covariance of {} rows",
                 problem.candidates.size(),
                 problem.covariance.rows());
}

// Compatible candidates of every observation, nearest first.
std::vector<std::vector<int>> CompatibleByObservation(const CompatibilityProblem& problem,
                                                      double gate) {
  std::vector<std::vector<int>> by_observation(static_cast<std::size_t>(problem.observations));
  std::vector<double> distance(problem.candidates.size());
  for (std::size_t c = 0; c < problem.candidates.size(); ++c) {
    distance[c] = IndividualDistance(problem, static_cast<int>(c));
    if (distance[c] > gate) continue;
    by_observation[static_cast<std::size_t>(problem.candidates[c].observation)].push_back(
        static_cast<int>(c));
  }
  for (std::vector<int>& candidates : by_observation) {
    std::stable_sort(candidates.begin(), candidates.end(), [&](int a, int b) {
      return distance[static_cast<std::size_t>(a)] < distance[static_cast<std::size_t>(b)];
    });
  }
  return by_observation;
}

class BranchAndBound {
 public:
  BranchAndBound(const CompatibilityProblem& problem, const CompatibilityOptions& options)
      : problem_(problem), max_nodes_(options.max_nodes) {
    choices_ = CompatibleByObservation(problem, ChiSquareQuantile(options.gate_probability, 2));
    // Observations from here on that can be paired at all.
    possible_.assign(choices_.size() + 1, 0);
    for (std::size_t i = choices_.size(); i-- > 0;) {
      possible_[i] = possible_[i + 1] + (choices_[i].empty() ? 0 : 1);
    }
    for (int pairings = 1; pairings <= possible_.front(); ++pairings) {
      gates_.push_back(ChiSquareQuantile(options.gate_probability, 2 * pairings));
    }
    const Eigen::Index rows = Eigen::Index{2} * possible_.front();
    factor_ = Eigen::MatrixXd::Zero(rows, rows);
    whitened_ = Eigen::VectorXd::Zero(rows);
    present_.assign(choices_.size(), -1);
  }

  JointAssociation Search() {
    best_.candidates = present_;
    if (!choices_.empty()) Descend(0, 0.0);
    return best_;
  }

 private:
  void Descend(std::size_t observation, double squared_distance) {
    if (observation == choices_.size()) {
      found_ = true;
      const auto pairings = static_cast<int>(branch_.size());
      if (!Better(pairings, squared_distance)) return;
      best_.candidates = present_;
      best_.pairings = pairings;
      best_.squared_distance = squared_distance;
      return;
    }
    for (const int candidate : choices_[observation]) {
      if (Exhausted()) return;
      const int landmark = problem_.candidates[static_cast<std::size_t>(candidate)].landmark;
      if (used_.contains(landmark)) continue;
      ++best_.nodes;
      const double distance = squared_distance + Extend(candidate);
      if (distance > gates_[branch_.size()]) continue;
      if (!Promising(observation + 1, branch_.size() + 1, distance)) continue;
      branch_.push_back(candidate);
      used_.insert(landmark);
      present_[observation] = candidate;
      Descend(observation + 1, distance);
      present_[observation] = -1;
      used_.erase(landmark);
      branch_.pop_back();
    }
    if (Exhausted()) return;
    ++best_.nodes;
    if (Promising(observation + 1, branch_.size(), squared_distance)) {
      Descend(observation + 1, squared_distance);
    }
  }

  // What a candidate adds to the squared distance of the branch. With S = L Lᵀ of the branch and
  // L y = nu: the new block row of L is [Xᵀ, M], X = L⁻¹ S_new, M Mᵀ = S_nn - Xᵀ X, and the new
  // part of y is M⁻¹ (nu_n - Xᵀ y).
  double Extend(int candidate) {
    const Eigen::Index row = Eigen::Index{2} * candidate;
    const auto size = static_cast<Eigen::Index>(2 * branch_.size());
    Eigen::MatrixXd X(size, 2);
    for (std::size_t i = 0; i < branch_.size(); ++i) {
      X.middleRows<2>(static_cast<Eigen::Index>(2 * i)) =
          problem_.covariance.block<2, 2>(Eigen::Index{2} * branch_[i], row);
    }
    factor_.topLeftCorner(size, size).triangularView<Eigen::Lower>().solveInPlace(X);
    const Eigen::Matrix2d schur = problem_.covariance.block<2, 2>(row, row) - X.transpose() * X;
    const Eigen::Matrix2d M = schur.llt().matrixL();
    const Eigen::Vector2d y = M.triangularView<Eigen::Lower>().solve(
        problem_.nu.segment<2>(row) - X.transpose() * whitened_.head(size));
    factor_.block(size, 0, 2, size) = X.transpose();
    factor_.block<2, 2>(size, size) = M;
    whitened_.segment<2>(size) = y;
    return y.squaredNorm();
  }

  bool Better(int pairings, double squared_distance) const {
    return pairings > best_.pairings ||
           (pairings == best_.pairings && squared_distance < best_.squared_distance);
  }

  // Distances only grow along a branch, so that a branch that can at most draw level in pairings
  // must already be nearer.
  bool Promising(std::size_t next, std::size_t pairings, double squared_distance) const {
    return !found_ || Better(static_cast<int>(pairings) + possible_[next], squared_distance);
  }

  bool Exhausted() {
    if (!found_ || best_.nodes < max_nodes_) return false;
    best_.complete = false;
    return true;
  }

  const CompatibilityProblem& problem_;
  std::int64_t max_nodes_;
  std::vector<double> gates_;  // By pairings - 1.
  std::vector<std::vector<int>> choices_;
  std::vector<int> possible_;

  std::vector<int> branch_;   // Candidates paired so far.
  std::set<int> used_;        // Their landmarks.
  std::vector<int> present_;  // As JointAssociation::candidates.
  Eigen::MatrixXd factor_;    // L of the branch; rows beyond it are left over.
  Eigen::VectorXd whitened_;
  JointAssociation best_;
  bool found_ = false;
};

}  // namespace

JointAssociation AssociateJointly(const CompatibilityProblem& problem,
                                  const CompatibilityOptions& options) {
  CheckProblem(problem);
  return BranchAndBound(problem, options).Search();
}

JointAssociation AssociateNearest(const CompatibilityProblem& problem,
                                  const CompatibilityOptions& options) {
  CheckProblem(problem);
  const double gate = ChiSquareQuantile(options.gate_probability, 2);
  JointAssociation result;
  result.candidates.assign(static_cast<std::size_t>(problem.observations), -1);
  std::vector<int> nearest;
  for (const std::vector<int>& choices : CompatibleByObservation(problem, gate)) {
    if (!choices.empty()) nearest.push_back(choices.front());
  }
  std::stable_sort(nearest.begin(), nearest.end(), [&](int a, int b) {
    return IndividualDistance(problem, a) < IndividualDistance(problem, b);
  });
  std::set<int> used;
  for (const int candidate : nearest) {
    const CompatibilityProblem::Candidate& pair =
        problem.candidates[static_cast<std::size_t>(candidate)];
    if (!used.insert(pair.landmark).second) continue;
    result.candidates[static_cast<std::size_t>(pair.observation)] = candidate;
    result.squared_distance += IndividualDistance(problem, candidate);
    ++result.pairings;
  }
  return result;
}

}  // namespace shiftmap
