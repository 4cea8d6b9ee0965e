// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <functional>
#include <memory>
#include <random>
#include <vector>

#include "mapper/graph/graph.h"

namespace shiftmap {

/// Standardized residuals of a graph, or noise on them. Those of observations are times the root of
/// their weight, so that they have the covariance I too.
struct GraphResiduals {
  IndexedVector<RunIndex, Eigen::Matrix3Xd> motions;  ///< A column a motion.
  Eigen::Matrix2Xd observations;                      ///< A column each.
};

/// Errors on residuals of observations, standardized and weighted as in GraphResiduals, by
/// amplitudes of which each run has some.
struct LinearErrors {
  Eigen::Index amplitudes = 0;
  IndexedVector<RunIndex, std::vector<Eigen::Index>> of_run;  ///< Each at most once.

  /// E: by how much the residual changes, a column for each of its run's amplitudes. Called from
  /// several threads.
  std::function<Eigen::Matrix2Xd(ObservationIndex)> of_observation;
};

/// The block of each key frame, from 0 on: its observations and the motion to the next.
using FrameBlocks = IndexedVector<RunIndex, IndexedVector<FrameIndex, int>>;

/// The Gaussian around a graph's values, with the inverse Hessian H⁻¹ as its covariance and the
/// loss by its curvature (robust_loss.h). The graph must outlive it and keep its values.
class GraphPosterior {
 public:
  virtual ~GraphPosterior() = default;

  /// Residuals of fits to noise: ε - J H⁻¹ Jᵀ ε for draws of a random sign ε on every standardized
  /// residual. Those of a graph whose noise is right are distributed alike.
  virtual std::vector<GraphResiduals> DrawFitResiduals(int count,
                                                       std::mt19937_64& random) const = 0;

  /// What the fit makes of such errors: the graph eliminated from their normal equations.
  struct ErrorFit {
    Eigen::MatrixXd information;  ///< Eᵀ (I - J H⁻¹ Jᵀ) E.
    Eigen::MatrixXd mode_steps;   ///< H⁻¹ Jᵀ E, two rows a mode, a column an amplitude. [m]
  };
  virtual ErrorFit FitErrors(const LinearErrors& errors) const = 0;

  /// The steps of the modes, H⁻¹ J_bᵀ e_b, that the residuals of each block by themselves lead to;
  /// two rows a mode, a column a block. [m]
  virtual Eigen::MatrixXd ModeStepsByBlock(const GraphResiduals& residuals,
                                           const FrameBlocks& block_of_frame,
                                           int blocks) const = 0;

  /// Joint covariance of the modes. [m²]
  virtual Eigen::MatrixXd ModeCovariance() const = 0;

  /// The joint covariance of the modes times `weights`, two rows a mode: some of its columns, or
  /// what they sum up to, without the rest.
  virtual Eigen::MatrixXd ModeCovarianceTimes(const Eigen::MatrixXd& weights) const = 0;

  /// Blocks of the joint covariance of the modes, each once: those of a mode with itself, of all
  /// pairs in the lists that LinearizeGraph() was given, and others that come along. [m²]
  using BlockVisitor =
      std::function<void(ModeIndex a, ModeIndex b, const Eigen::Matrix2d& cov_a_b)>;
  virtual void VisitModeCovariance(const BlockVisitor& visitor) const = 0;

  /// Covariance of p_a - p_b, of two modes. [m²]
  virtual Eigen::Matrix2d ModeDifferenceCovariance(ModeIndex a, ModeIndex b) const = 0;

  /// Draws of all modes' errors, a column each; the poses are left out.
  virtual Eigen::MatrixXd DrawModes(int draws, std::mt19937_64& random) const = 0;

  /// The inverse of the joint covariance of all runs' calibrations, kRunCalibration rows a run,
  /// times a matrix.
  virtual Eigen::MatrixXd CalibrationInformationTimes(const Eigen::MatrixXd& weights) const = 0;
};

/// The posterior by the graph's own solver; null if the graph does not determine its modes in the
/// numbers that a computer has. Precondition: every mode is observed or in the prior.
/// @param required_sets  Lists of modes, all pairs in each of which VisitModeCovariance() visits.
std::unique_ptr<GraphPosterior> LinearizeGraph(
    const Graph& graph, const std::vector<std::vector<ModeIndex>>& required_sets = {});

/// The residuals at the graph's values. An observation's has its slope, divided by the root of its
/// curvature: Jᵀ of all is the gradient of the cost.
GraphResiduals PresentResiduals(const Graph& graph);

/// The statistics of each run, as ComputeRunStatistics() of the graph.
RunStatistics ComputeRunStatistics(const Graph& graph,
                                   const GraphPosterior& posterior,
                                   int samples,
                                   std::uint64_t seed);

}  // namespace shiftmap
