// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/map_scale.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <utility>
#include <vector>

#include "mapstore/geometry/inner_constraints.h"
#include "mapstore/map/joint_covariance.h"

namespace shiftmap {
namespace {

// The largest variance v for which P' - v q qᵀ is a covariance: 1 / qᵀP'⁻¹q.
double LargestVariance(const Eigen::VectorXd& q, const Eigen::MatrixXd& cov) {
  const Eigen::LLT<Eigen::MatrixXd> llt(cov);
  if (llt.info() != Eigen::Success) return 0.0;
  return 1.0 / llt.matrixL().solve(q).squaredNorm();
}

}  // namespace

MapScale RemoveScale(double sd_sensors, MapContent* content) {
  // Less than the largest by this share: what is left is positive definite.
  constexpr double kLeft = 1e-6;
  std::vector<Eigen::Vector2d> positions;
  for (const LandmarkGroup& group : content->groups) {
    for (const Mode& mode : group.modes) positions.push_back(mode.p_map_landmark);
  }
  if (positions.empty()) return {};
  const JointCovariance& cov = content->covariance;
  const Eigen::Vector2d centroid = Centroid(positions);
  double variance = std::numeric_limits<double>::infinity();
  for (const std::vector<int>& modes : cov.JointSets()) {
    std::vector<Eigen::Vector2d> of_set;
    for (const int mode : modes)
      of_set.push_back(positions[static_cast<std::size_t>(mode)] - centroid);
    const Eigen::Map<const Eigen::VectorXd> q(of_set.front().data(), 2 * std::ssize(of_set));
    variance = std::min(variance, LargestVariance(q, cov.Dense(modes)));
  }
  variance *= 1.0 - kLeft;
  if (!(variance >= (1.0 - 2.0 * kLeft) * sd_sensors * sd_sensors && std::isfinite(variance))) {
    return {};
  }
  const auto of_scale = [&](int row, int column) -> Eigen::Matrix2d {
    return variance * (positions[static_cast<std::size_t>(row)] - centroid) *
           (positions[static_cast<std::size_t>(column)] - centroid).transpose();
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
  return {std::sqrt(variance), centroid};
}

}  // namespace shiftmap
