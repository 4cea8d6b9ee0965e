// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <functional>
#include <memory>
#include <random>
#include <utility>
#include <vector>

#include "mapper/graph/cholesky_factor.h"
#include "mapper/graph/graph_posterior.h"
#include "mapper/graph/schur_system.h"

namespace shiftmap {

/// Noise on every standardized residual, a random sign each, and the step x = H⁻¹ Jᵀ ε that it
/// leads to, which has the covariance H⁻¹. What the fit leaves of it, ε - J x, is a residual of a
/// graph whose noise is right.
struct ResidualSample {
  GraphResiduals noise;
  GraphStep step;
};

/// The Gaussian around a graph's values by nested elimination (SchurSystem), with the loss by its
/// curvature.
class SchurPosterior final : public GraphPosterior {
 public:
  /// As LinearizeGraph().
  /// @param reduced  Of a graph that may be of the same shape, or null; then that of this one, or
  ///                 null if it is not determined.
  static std::unique_ptr<SchurPosterior> Of(
      const Graph& graph,
      const std::vector<std::vector<ModeIndex>>& required_sets,
      std::unique_ptr<ReducedSystem>* reduced);

  std::vector<ResidualSample> SampleResiduals(int count, std::mt19937_64& random) const;

  std::vector<GraphResiduals> DrawFitResiduals(int count, std::mt19937_64& random) const override;
  ErrorFit FitErrors(const LinearErrors& errors) const override;
  Eigen::MatrixXd ModeStepsByBlock(const GraphResiduals& residuals,
                                   const FrameBlocks& block_of_frame,
                                   int blocks) const override;
  Eigen::MatrixXd ModeCovariance() const override;
  Eigen::MatrixXd ModeCovarianceTimes(const Eigen::MatrixXd& weights) const override;

  /// As costly as a factorization.
  void VisitModeCovariance(const BlockVisitor& visitor) const override;

  /// As costly as the part of the factor that the two modes touch.
  Eigen::Matrix2d ModeDifferenceCovariance(ModeIndex a, ModeIndex b) const override;
  Eigen::MatrixXd DrawModes(int draws, std::mt19937_64& random) const override;
  Eigen::MatrixXd CalibrationInformationTimes(const Eigen::MatrixXd& weights) const override;

 private:
  class Gradients;

  // Adds Jᵀ ε of a segment to the right sides of its poses and boundary, a column each.
  using AddNoise = std::function<void(const GraphSegment& segment, Gradients* gradients)>;

  SchurPosterior(const Graph& graph,
                 SchurSystem system,
                 std::shared_ptr<const CholeskyFactor> factor)
      : graph_(graph), system_(std::move(system)), factor_(std::move(factor)) {}

  int ModeRows() const { return 2 * graph_.modes.end_index().value(); }
  Eigen::MatrixXd SolveNoise(const AddNoise& add_noise,
                             Eigen::MatrixXd reduced,
                             std::vector<PoseRows>* inside) const;
  Eigen::MatrixXd PriorNoise(int count, std::mt19937_64& random) const;

  const Graph& graph_;
  SchurSystem system_;
  std::shared_ptr<const CholeskyFactor> factor_;  // Of the reduced system.
};

}  // namespace shiftmap
