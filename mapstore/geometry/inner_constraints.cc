// SPDX-License-Identifier: Apache-2.0
#include "mapstore/geometry/inner_constraints.h"

#include <utility>

namespace shiftmap {

Eigen::Vector2d Centroid(const std::vector<Eigen::Vector2d>& positions) {
  Eigen::Vector2d centroid = Eigen::Vector2d::Zero();
  for (const Eigen::Vector2d& position : positions) {
    centroid += position / static_cast<double>(positions.size());
  }
  return centroid;
}

Eigen::MatrixXd GaugeDirections(const std::vector<Eigen::Vector2d>& positions) {
  const auto count = static_cast<Eigen::Index>(positions.size());
  const Eigen::Vector2d centroid = Centroid(positions);
  Eigen::MatrixXd G(2 * count, 3);
  for (Eigen::Index i = 0; i < count; ++i) {
    const Eigen::Vector2d offset = positions[static_cast<std::size_t>(i)] - centroid;
    G.row(2 * i) << 1.0, 0.0, -offset.y();
    G.row(2 * i + 1) << 0.0, 1.0, offset.x();
  }
  // The columns are orthogonal because the rotation is about the centroid. If all positions are
  // one, no rotation moves them, and its column is zero.
  for (Eigen::Index column = 0; column < 3; ++column) {
    const double norm = G.col(column).norm();
    if (norm > 0.0) G.col(column) /= norm;
  }
  return G;
}

Eigen::VectorXd OffsetsFromCentroid(const std::vector<Eigen::Vector2d>& positions) {
  const Eigen::Vector2d centroid = Centroid(positions);
  Eigen::VectorXd q(static_cast<Eigen::Index>(2 * positions.size()));
  for (std::size_t i = 0; i < positions.size(); ++i) {
    q.segment<2>(static_cast<Eigen::Index>(2 * i)) = positions[i] - centroid;
  }
  return q;
}

STransformation::STransformation(Eigen::MatrixXd directions,
                                 const Eigen::MatrixXd& cov_times_directions)
    : G(std::move(directions)),
      W(cov_times_directions - 0.5 * G * (G.transpose() * cov_times_directions)) {}

Eigen::Matrix2d STransformation::Refer(int a, int b, const Eigen::Matrix2d& cov_a_b) const {
  const auto G_a = G.middleRows<2>(Eigen::Index{2} * a);
  const auto G_b = G.middleRows<2>(Eigen::Index{2} * b);
  const auto W_a = W.middleRows<2>(Eigen::Index{2} * a);
  const auto W_b = W.middleRows<2>(Eigen::Index{2} * b);
  return cov_a_b - G_a * W_b.transpose() - W_a * G_b.transpose();
}

}  // namespace shiftmap
