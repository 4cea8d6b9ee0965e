// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "mapper/graph/graph.h"
#include "mapper/graph/graph_segments.h"
#include "mapper/graph/graph_step.h"
#include "mapper/graph/reduced_system.h"
#include "mapper/graph/segment.h"
#include "mapper/graph/segment_linearizer.h"

namespace shiftmap {

/// The normal equations of a graph, solved by nested elimination. A run's chain of poses is cut
/// into segments by separators; a segment couples with its two separators, its run's calibration
/// and the few modes seen from it, and is eliminated by itself. Their Schur complements add up to
/// the reduced system over separators, calibrations and modes. Linear in the length of runs,
/// without a dense matrix over poses.
class SchurSystem {
 public:
  /// A step to the minimum of the cost as it is linearized.
  struct Step {
    GraphStep step;
    double expected_decrease = 0.0;  ///< Of the cost.
  };

  /// @param graph          Must outlive this; its values may change, its shape may not.
  /// @param reduced        Of a graph that may be of the same shape: it then spares finding an
  ///                       order, and its factor may do. May be null.
  /// @param required_sets  Lists of modes, all pairs in each of which the factor has entries for.
  explicit SchurSystem(const Graph& graph,
                       std::unique_ptr<ReducedSystem> reduced = nullptr,
                       const std::vector<std::vector<ModeIndex>>& required_sets = {});

  /// Linearizes at the present values and eliminates the segments. False if one of them is not
  /// determined or the cost is no number.
  /// @param damping  Share by which the diagonal of the normal equations is raised (Marquardt).
  bool Linearize(LossWeighting weighting, double damping = 0.0);

  /// Half the sum of all losses at the last linearization.
  double cost() const { return cost_; }

  /// The same at the present values, a fraction of a linearization. NaN where Linearize() would
  /// have no cost.
  double PresentCost() const;

  /// The Gauss-Newton step from the last linearization (ReducedSystem::Solve). Nothing if it is not
  /// determined.
  std::optional<Step> Solve();

  /// The factor of the reduced system of the last linearization; null if that is not determined.
  std::shared_ptr<const CholeskyFactor> Factorize() { return reduced_->Factorize(); }

  /// Goes on to a similar graph.
  std::unique_ptr<ReducedSystem> TakeReduced() { return std::move(reduced_); }

  const GraphSegments& segments() const { return segments_; }
  const SegmentLinearizer& linearizer() const { return linearizer_; }

  /// Of a segment, at the last linearization.
  const SegmentFactor& factor(std::size_t segment) const { return factors_[segment]; }

  /// The poses' step inside a segment, given its boundary's.
  using Inside =
      std::function<Eigen::VectorXd(std::size_t segment, const Eigen::VectorXd& boundary)>;

  /// The step of everything, given that of the reduced system.
  GraphStep Complete(const Eigen::VectorXd& reduced, const Inside& inside) const;

 private:
  double PriorCost() const;
  Eigen::VectorXd PriorDifference(const GraphPrior& prior) const;
  void AddPriors();
  void AddRequiredSets();

  const Graph& graph_;
  const GraphSegments segments_;
  const SegmentLinearizer linearizer_;
  const std::vector<std::vector<ModeIndex>> required_sets_;
  std::vector<SegmentFactor> factors_;
  std::unique_ptr<ReducedSystem> reduced_;
  double cost_ = 0.0;
};

}  // namespace shiftmap
