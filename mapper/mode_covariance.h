// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "mapper/graph/elimination.h"
#include "mapper/graph/graph.h"
#include "mapstore/map/joint_covariance.h"

namespace shiftmap {

/// Maps of up to as many modes have the joint covariance of all of them.
inline constexpr int kMaxJointModes = 300;

/// How well a graph's modes are known against each other. Up to kMaxJointModes modes it is their
/// joint covariance; beyond, single differences are solved for on the sparse factor, and most of
/// them need not be: the marginals bound them.
class ModeDifferences {
 public:
  /// Around the graph's present values. The graph must outlive this.
  /// Precondition: every mode is observed or in the prior.
  explicit ModeDifferences(const Graph& graph);

  /// From the joint covariance of all modes. [m²]
  explicit ModeDifferences(Eigen::MatrixXd joint) : joint_(std::move(joint)) {}

  /// Covariance of p_a - p_b. [m²]
  Eigen::Matrix2d Covariance(int a, int b) const;

  /// At least the variance of p_a - p_b along any direction; infinite if nothing is known without
  /// Covariance(). With the datum of the positions as a whole, of which the marginals P'_aa are
  /// small, p_a - p_b changes by its share of a rotation θ:
  ///
  ///   Var <= 2 (2 tr P'_aa + 2 tr P'_bb + ‖p_a - p_b‖² Var θ). [m²]
  double MaxVariance(int a, int b) const;

 private:
  Eigen::MatrixXd joint_;         // Of few modes.
  const Graph* graph_ = nullptr;  // Of many, as what follows.
  std::unique_ptr<GraphElimination> elimination_;
  std::vector<double> traces_;      // Of P'. [m²]
  double rotation_variance_ = 0.0;  // [rad²]
};

/// Modes in tiles of at most `size`, by halves of the longer side; every mode is in one.
std::vector<std::vector<int>> TileModes(const std::vector<Eigen::Vector2d>& positions, int size);

/// Covariance of a graph's modes as a map has it: referred to the positions as a whole
/// (ReferToPositions) and with the uncertainty of scale (AddScaleUncertainty), order of
/// Graph::modes. Beyond kMaxJointModes modes it is that of modes in one tile of neighbours;
/// between tiles it is zero, and positive definite all the same, as any block-diagonal part of a
/// covariance is. [m²]
/// Precondition: every mode is observed or in the prior.
JointCovariance MapCovariance(const Graph& graph, double sd_range_scale);

}  // namespace shiftmap
