// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

namespace shiftmap {

/// Which landmark each observation of a scan may be, with what that says jointly.
struct CompatibilityProblem {
  struct Candidate {
    int observation = 0;  ///< In 0..observations - 1.
    int landmark = 0;
  };

  int observations = 0;
  std::vector<Candidate> candidates;  ///< By observation.
  Eigen::VectorXd nu;                 ///< Their innovations stacked, two rows each.

  /// Joint covariance of `nu`: H_a P H_bᵀ, plus R in the diagonal blocks. Blocks between candidates
  /// of one observation, or of one landmark, are never used.
  Eigen::MatrixXd covariance;
};

struct CompatibilityOptions {
  /// An innovation, or a set of them, is compatible within this quantile of the chi-square
  /// distribution. Raising it pairs more, also more wrongly.
  double gate_probability = 0.99;

  /// Nodes of the search at most. The first descent is the sequential nearest neighbour with joint
  /// gates and is always completed: with a small bound that is the answer.
  std::int64_t max_nodes = 20000;
};

struct JointAssociation {
  std::vector<int> candidates;  ///< Per observation an index in the problem's candidates, or -1.
  int pairings = 0;
  double squared_distance = 0.0;  ///< Joint squared Mahalanobis distance of the pairings.
  std::int64_t nodes = 0;
  bool complete = true;  ///< False: the bound on nodes ended the search.
};

/// Joint compatibility branch and bound (Neira, Tardós: "Data association in stochastic mapping
/// using the joint compatibility test", IEEE T-RA 17(6), 2001).
///
/// Among the hypotheses that pair every landmark at most once and that stay inside the joint gate
/// as the observations are added in order, the one with most pairings; among equals the one with
/// the smallest joint distance. The distance is updated along a branch by one more block row of a
/// Cholesky factor: a node costs the square of the pairings so far.
JointAssociation AssociateJointly(const CompatibilityProblem& problem,
                                  const CompatibilityOptions& options);

/// The baseline: every observation takes its nearest individually compatible landmark; of several
/// that want one landmark the nearest has it. `squared_distance` is the sum of the individual ones.
JointAssociation AssociateNearest(const CompatibilityProblem& problem,
                                  const CompatibilityOptions& options);

}  // namespace shiftmap
