// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/ceres_posterior.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <numeric>
#include <optional>
#include <utility>

#include "mapper/graph/ceres_problem.h"
#include "mapper/graph/random_signs.h"
#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

// Right sides that are solved for at a time: each takes as much memory as all unknowns.
constexpr Eigen::Index kColumns = 256;

// The rows of motions and observations in the Jacobian.
Eigen::VectorXd RowsOf(const GraphResiduals& residuals, Eigen::Index rows) {
  Eigen::VectorXd all = Eigen::VectorXd::Zero(rows);
  Eigen::Index row = 0;
  const auto append = [&](const auto& values) {
    all.segment(row, values.size()) = values.reshaped();
    row += values.size();
  };
  for (const Eigen::Matrix3Xd& motions : residuals.motions) append(motions);
  append(residuals.observations);
  return all;
}

GraphResiduals ResidualsOf(const Graph& graph, const Eigen::VectorXd& rows) {
  GraphResiduals residuals;
  Eigen::Index row = 0;
  for (const GraphRun& run : graph.runs) {
    Eigen::Matrix3Xd& motions = residuals.motions.emplace_back(3, std::ssize(run.motions));
    motions.reshaped() = rows.segment(row, motions.size());
    row += motions.size();
  }
  residuals.observations.resize(2, std::ssize(graph.observations));
  residuals.observations.reshaped() = rows.segment(row, residuals.observations.size());
  return residuals;
}

// Noise on all rows of the Jacobian, a column a draw: that of SchurPosterior for the same
// generator, so that both estimate the same noise of a graph.
Eigen::MatrixXd DrawNoise(const Graph& graph,
                          int count,
                          Eigen::Index rows,
                          std::mt19937_64& random) {
  Eigen::MatrixXd noise(rows, count);
  Eigen::Index priors = 0;
  RandomSigns of_residuals(&random);
  for (int draw = 0; draw < count; ++draw) {
    GraphResiduals residuals;
    for (const GraphRun& run : graph.runs) {
      of_residuals.Fill(std::ssize(run.motions), &residuals.motions.emplace_back());
    }
    of_residuals.Fill(std::ssize(graph.observations), &residuals.observations);
    noise.col(draw) = RowsOf(residuals, rows);
    priors = residuals.observations.size();
    for (const Eigen::Matrix3Xd& motions : residuals.motions) priors += motions.size();
  }
  RandomSigns of_priors(&random);
  const auto append = [&](Eigen::Index size) {
    Eigen::MatrixXd signs(size, count);
    of_priors.Fill(count, &signs);
    noise.middleRows(priors, size) = signs;
    priors += size;
  };
  for (std::size_t r = 0; r < graph.runs.size(); ++r) append(kRunCalibration);
  for (const GraphPrior& prior : graph.priors) append(prior.sqrt_information.rows());
  return noise;
}

// The block of each row of the Jacobian that is of a motion or an observation.
std::vector<int> BlockOfRow(const Graph& graph, const FrameBlocks& block_of_frame) {
  std::vector<int> blocks;
  for (const RunIndex r : graph.runs.indices()) {
    for (const FrameIndex i : graph.runs[r].motions.indices()) {
      blocks.insert(blocks.end(), 3, block_of_frame[r][i]);
    }
  }
  for (const GraphObservation& item : graph.observations) {
    blocks.insert(blocks.end(), 2, block_of_frame[item.run][item.frame]);
  }
  return blocks;
}

}  // namespace

std::unique_ptr<CeresPosterior> CeresPosterior::Of(
    const Graph& graph, std::vector<std::vector<ModeIndex>> required_sets) {
  const std::optional<Jacobian> jacobian =
      CeresProblem(graph, CeresProblem::Weighting::kCurvature).Jacobian();
  if (!jacobian) return nullptr;
  std::unique_ptr<CeresPosterior> posterior(
      new CeresPosterior(graph, std::move(required_sets), *jacobian));
  if (posterior->factor_.info() != Eigen::Success) return nullptr;
  return posterior;
}

CeresPosterior::CeresPosterior(const Graph& graph,
                               std::vector<std::vector<ModeIndex>> required_sets,
                               const Jacobian& jacobian)
    : graph_(graph), required_sets_(std::move(required_sets)), J_(jacobian) {
  if (required_sets_.empty()) {
    required_sets_.emplace_back(graph.modes.size());
    std::iota(required_sets_.front().begin(), required_sets_.front().end(), ModeIndex(0));
  }
  first_mode_ = J_.cols() - ModeRows();
  first_calibration_ = first_mode_ - CalibrationRows();
  factor_.compute(Eigen::SparseMatrix<double>(J_.transpose() * J_));
}

Eigen::Index CeresPosterior::ModeRows() const { return 2 * graph_.modes.end_index(); }

Eigen::Index CeresPosterior::CalibrationRows() const {
  return kRunCalibration * graph_.runs.end_index();
}

Eigen::MatrixXd CeresPosterior::SolveFor(Eigen::Index first, const Eigen::MatrixXd& b) const {
  Eigen::MatrixXd right = Eigen::MatrixXd::Zero(J_.cols(), b.cols());
  right.middleRows(first, b.rows()) = b;
  return factor_.solve(right);
}

std::vector<GraphResiduals> CeresPosterior::DrawFitResiduals(int count,
                                                             std::mt19937_64& random) const {
  const Eigen::MatrixXd noise = DrawNoise(graph_, count, J_.rows(), random);
  const Eigen::MatrixXd left = noise - J_ * factor_.solve(J_.transpose() * noise);
  std::vector<GraphResiduals> draws;
  for (Eigen::Index draw = 0; draw < left.cols(); ++draw) {
    draws.push_back(ResidualsOf(graph_, left.col(draw)));
  }
  return draws;
}

GraphPosterior::ErrorFit CeresPosterior::FitErrors(const LinearErrors& errors) const {
  Eigen::MatrixXd E = Eigen::MatrixXd::Zero(J_.rows(), errors.amplitudes);
  Eigen::Index row = 0;
  for (const GraphRun& run : graph_.runs) row += 3 * std::ssize(run.motions);
  for (const ObservationIndex i : graph_.observations.indices()) {
    const std::vector<Eigen::Index>& columns = errors.of_run[graph_.observations[i].run];
    E(Eigen::seqN(row + 2 * i, 2), columns) = errors.of_observation(i);
  }
  const Eigen::MatrixXd right = J_.transpose() * E;
  const Eigen::MatrixXd steps = factor_.solve(right);
  const Eigen::MatrixXd information = E.transpose() * E - right.transpose() * steps;
  return {Symmetrized(information), steps.bottomRows(ModeRows())};
}

Eigen::MatrixXd CeresPosterior::ModeStepsByBlock(const GraphResiduals& residuals,
                                                 const FrameBlocks& block_of_frame,
                                                 int blocks) const {
  const Eigen::VectorXd all = RowsOf(residuals, J_.rows());
  const std::vector<int> block_of_row = BlockOfRow(graph_, block_of_frame);
  Eigen::MatrixXd by_block = Eigen::MatrixXd::Zero(J_.rows(), blocks);
  for (std::size_t row = 0; row < block_of_row.size(); ++row) {
    const auto i = static_cast<Eigen::Index>(row);
    by_block(i, block_of_row[row]) = all[i];
  }
  return factor_.solve(J_.transpose() * by_block).bottomRows(ModeRows());
}

Eigen::MatrixXd CeresPosterior::ModeCovariance() const {
  return Symmetrized(ModeCovarianceTimes(Eigen::MatrixXd::Identity(ModeRows(), ModeRows())));
}

Eigen::MatrixXd CeresPosterior::ModeCovarianceTimes(const Eigen::MatrixXd& weights) const {
  Eigen::MatrixXd result(weights.rows(), weights.cols());
  for (Eigen::Index column = 0; column < weights.cols(); column += kColumns) {
    const Eigen::Index columns = std::min(kColumns, weights.cols() - column);
    result.middleCols(column, columns) =
        SolveFor(first_mode_, weights.middleCols(column, columns)).bottomRows(weights.rows());
  }
  return result;
}

void CeresPosterior::VisitModeCovariance(const BlockVisitor& visitor) const {
  for (const std::vector<ModeIndex>& modes : required_sets_) {
    Eigen::MatrixXd weights = Eigen::MatrixXd::Zero(ModeRows(), 2 * std::ssize(modes));
    for (std::size_t i = 0; i < modes.size(); ++i) {
      weights.block<2, 2>(2 * modes[i], static_cast<Eigen::Index>(2 * i)).setIdentity();
    }
    const Eigen::MatrixXd cov = ModeCovarianceTimes(weights);
    for (std::size_t i = 0; i < modes.size(); ++i) {
      for (std::size_t j = i; j < modes.size(); ++j) {
        const Eigen::Matrix2d block =
            cov.block<2, 2>(2 * modes[i], static_cast<Eigen::Index>(2 * j));
        visitor(modes[i], modes[j], i == j ? Symmetrized(block) : block);
      }
    }
  }
}

Eigen::Matrix2d CeresPosterior::ModeDifferenceCovariance(ModeIndex a, ModeIndex b) const {
  Eigen::MatrixXd difference = Eigen::MatrixXd::Zero(ModeRows(), 2);
  difference.middleRows<2>(2 * a).setIdentity();
  difference.middleRows<2>(2 * b) = -Eigen::Matrix2d::Identity();
  const Eigen::Matrix2d cov = difference.transpose() * ModeCovarianceTimes(difference);
  return Symmetrized(cov);
}

Eigen::MatrixXd CeresPosterior::DrawModes(int draws, std::mt19937_64& random) const {
  std::normal_distribution<double> normal;
  Eigen::MatrixXd z(J_.cols(), draws);
  for (double& value : z.reshaped()) value = normal(random);
  // H = Pᵀ L Lᵀ P.
  const Eigen::MatrixXd x = factor_.matrixU().solve(z);
  return (factor_.permutationPinv() * x).bottomRows(ModeRows());
}

Eigen::MatrixXd CeresPosterior::CalibrationInformationTimes(const Eigen::MatrixXd& weights) const {
  const Eigen::Index rows = CalibrationRows();
  const Eigen::MatrixXd cov = SolveFor(first_calibration_, Eigen::MatrixXd::Identity(rows, rows))
                                  .middleRows(first_calibration_, rows);
  return Symmetrized(cov).llt().solve(weights);
}

}  // namespace shiftmap
