// SPDX-License-Identifier: Apache-2.0
#include "mapper/covariance/map_prior.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numeric>
#include <utility>

#include "mapper/covariance/gauge.h"
#include "mapper/covariance/mode_covariance.h"
#include "mapper/rows.h"

namespace shiftmap {
namespace {

// Sets of modes that are told together.
std::vector<std::vector<int>> Sets(const JointCovariance& cov) {
  if (cov.size() > kMaxJointModes) return cov.Components();
  std::vector<int> all(static_cast<std::size_t>(cov.size()));
  std::iota(all.begin(), all.end(), 0);
  return {std::move(all)};
}

// The largest variance v for which P' - v q qᵀ is a covariance: 1 / qᵀP'⁻¹q.
double LargestVariance(const Eigen::VectorXd& q, const Eigen::MatrixXd& cov) {
  const Eigen::LLT<Eigen::MatrixXd> llt(cov);
  if (llt.info() != Eigen::Success) return 0.0;
  return 1.0 / llt.matrixL().solve(q).squaredNorm();
}

}  // namespace

double RemoveScale(double sd_sensors, MapContent* content) {
  // Less than the largest by this share: what is left is positive definite.
  constexpr double kLeft = 1e-6;
  std::vector<Eigen::Vector2d> positions;
  for (const LandmarkGroup& group : content->groups) {
    for (const Mode& mode : group.modes) positions.push_back(mode.p_map_landmark);
  }
  const JointCovariance& cov = content->covariance;
  const Eigen::VectorXd q = OffsetsFromCentroid(positions);
  double variance = std::numeric_limits<double>::infinity();
  for (const std::vector<int>& modes : Sets(cov)) {
    variance = std::min(variance, LargestVariance(q(RowsOf(modes)), cov.Dense(modes)));
  }
  variance *= 1.0 - kLeft;
  if (!(variance >= (1.0 - 2.0 * kLeft) * sd_sensors * sd_sensors && std::isfinite(variance))) {
    return 0.0;
  }
  const auto of_scale = [&](int row, int column) -> Eigen::Matrix2d {
    return variance * q.segment<2>(Eigen::Index{2} * row) *
           q.segment<2>(Eigen::Index{2} * column).transpose();
  };
  std::vector<Eigen::Matrix2d> diagonal;
  for (int mode = 0; mode < cov.size(); ++mode) {
    diagonal.push_back(cov.Block(mode, mode) - of_scale(mode, mode));
  }
  std::vector<JointCovariance::CrossBlock> cross = cov.cross_blocks();
  for (JointCovariance::CrossBlock& block : cross) block.value -= of_scale(block.row, block.column);
  std::size_t i = 0;
  for (LandmarkGroup& group : content->groups) {
    for (Mode& mode : group.modes) mode.cov_p_map_landmark = diagonal[i++];
  }
  content->covariance = JointCovariance(std::move(diagonal), std::move(cross));
  return std::sqrt(variance);
}

std::vector<GraphPrior> MakeMapPrior(const IndexedVector<ModeIndex, Eigen::Vector2d>& positions,
                                     const JointCovariance& cov) {
  std::vector<GraphPrior> priors;
  if (cov.size() == 0) return priors;
  const std::vector<std::vector<int>> sets = Sets(cov);
  for (const std::vector<int>& set : sets) {
    const std::vector<ModeIndex> modes(set.begin(), set.end());
    std::vector<Eigen::Vector2d> of_modes;
    for (const ModeIndex mode : modes) of_modes.push_back(positions[mode]);
    const Eigen::MatrixXd joint = cov.Dense(set);
    priors.push_back(sets.size() == 1 ? MakeGraphPrior(modes, of_modes, joint)
                                      : MakeLocatedPrior(modes, of_modes, joint));
  }
  return priors;
}

}  // namespace shiftmap
