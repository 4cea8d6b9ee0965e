// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/SparseCholesky>
#include <Eigen/SparseCore>
#include <memory>
#include <vector>

#include "mapper/graph/graph_posterior.h"

namespace shiftmap {

/// The Gaussian around a graph's values from the Jacobian J that Ceres evaluates, with Eigen's
/// sparse Cholesky factor of H = JᵀJ.
class CeresPosterior final : public GraphPosterior {
 public:
  /// As LinearizeGraph().
  static std::unique_ptr<CeresPosterior> Of(const Graph& graph,
                                            std::vector<std::vector<ModeIndex>> required_sets);

  std::vector<GraphResiduals> DrawFitResiduals(int count, std::mt19937_64& random) const override;
  ErrorFit FitErrors(const LinearErrors& errors) const override;
  Eigen::MatrixXd ModeStepsByBlock(const GraphResiduals& residuals,
                                   const FrameBlocks& block_of_frame,
                                   int blocks) const override;
  Eigen::MatrixXd ModeCovariance() const override;
  Eigen::MatrixXd ModeCovarianceTimes(const Eigen::MatrixXd& weights) const override;

  void VisitModeCovariance(const BlockVisitor& visitor) const override;
  Eigen::Matrix2d ModeDifferenceCovariance(ModeIndex a, ModeIndex b) const override;
  Eigen::MatrixXd DrawModes(int draws, std::mt19937_64& random) const override;
  Eigen::MatrixXd CalibrationInformationTimes(const Eigen::MatrixXd& weights) const override;

 private:
  using Jacobian = Eigen::SparseMatrix<double, Eigen::RowMajor>;

  CeresPosterior(const Graph& graph,
                 std::vector<std::vector<ModeIndex>> required_sets,
                 const Jacobian& jacobian);

  Eigen::Index ModeRows() const;
  Eigen::Index CalibrationRows() const;

  // Rows of H⁻¹ b, of right sides that are zero but in rows [first, first + b.rows()).
  Eigen::MatrixXd SolveFor(Eigen::Index first, const Eigen::MatrixXd& b) const;

  const Graph& graph_;
  std::vector<std::vector<ModeIndex>> required_sets_;
  Jacobian J_;
  Eigen::SimplicialLLT<Eigen::SparseMatrix<double>> factor_;  // Of H.
  Eigen::Index first_calibration_;                            // Columns of J.
  Eigen::Index first_mode_;
};

}  // namespace shiftmap
