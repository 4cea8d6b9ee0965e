// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/ceres_problem.h"

#include <ceres/crs_matrix.h>
#include <ceres/loss_function.h>
#include <ceres/normal_prior.h>
#include <glog/logging.h>

#include <algorithm>
#include <cmath>

#include "mapper/graph/ceres_costs.h"
#include "mapper/graph/residuals.h"
#include "mapper/graph/robust_loss.h"

namespace shiftmap {
namespace {

// Ceres logs pages of values that are not finite; callers learn of them by the result.
ceres::Problem::Options ProblemOptions() {
  FLAGS_minloglevel = google::GLOG_FATAL;
  ceres::Problem::Options options;
  options.disable_all_safety_checks = true;
  return options;
}

// RobustLoss as Ceres takes it, which does without ρ'' where that is not positive.
class ObservationLoss final : public ceres::LossFunction {
 public:
  ObservationLoss(const RobustLoss& loss, CeresProblem::Weighting weighting)
      : loss_(loss), weighting_(weighting) {}

  void Evaluate(double squared, double rho[3]) const override {
    const bool slope = weighting_ == CeresProblem::Weighting::kSlope;
    rho[0] = 2.0 * loss_.HalfLoss(squared);
    rho[1] = slope ? loss_.Slope(squared) : loss_.Curvature(squared);
    rho[2] = 0.0;
  }

 private:
  RobustLoss loss_;
  CeresProblem::Weighting weighting_;
};

// r = A (p - mean) over many two-dimensional blocks.
class ModesPriorCost final : public ceres::CostFunction {
 public:
  explicit ModesPriorCost(const GraphPrior& prior) : prior_(prior) {
    set_num_residuals(static_cast<int>(prior.sqrt_information.rows()));
    for (std::size_t i = 0; i < prior.modes.size(); ++i)
      mutable_parameter_block_sizes()->push_back(2);
  }

  bool Evaluate(double const* const* parameters,
                double* residuals,
                double** jacobians) const override {
    Eigen::VectorXd difference(prior_.mean.size());
    for (std::size_t i = 0; i < prior_.modes.size(); ++i) {
      const auto at = static_cast<Eigen::Index>(2 * i);
      difference.segment<2>(at) =
          Eigen::Map<const Eigen::Vector2d>(parameters[i]) - prior_.mean.segment<2>(at);
    }
    const Eigen::Index rows = prior_.sqrt_information.rows();
    Eigen::Map<Eigen::VectorXd>(residuals, rows) = prior_.sqrt_information * difference;
    if (jacobians == nullptr) return true;
    for (std::size_t i = 0; i < prior_.modes.size(); ++i) {
      if (jacobians[i] == nullptr) continue;
      Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, 2, Eigen::RowMajor>>(jacobians[i], rows, 2) =
          prior_.sqrt_information.middleCols<2>(static_cast<Eigen::Index>(2 * i));
    }
    return true;
  }

 private:
  const GraphPrior& prior_;
};

}  // namespace

CeresProblem::CeresProblem(const Graph& graph, Weighting weighting) : problem_(ProblemOptions()) {
  for (const Eigen::Vector2d& mode : graph.modes) modes_.push_back({mode.x(), mode.y()});
  for (const GraphRun& run : graph.runs) {
    corrections_.push_back({run.correction.x(), run.correction.y(), run.correction.z()});
    biases_.push_back({run.sensor_bias.x(), run.sensor_bias.y(), run.sensor_bias.z()});
    poses_.emplace_back();
    for (const Se2& pose : run.poses) poses_.back().push_back({pose.x(), pose.y(), pose.yaw()});
  }
  for (auto& poses : poses_) {
    for (auto& pose : poses) problem_.AddParameterBlock(pose.data(), 3);
  }
  for (auto& mode : modes_) problem_.AddParameterBlock(mode.data(), 2);
  for (const RunIndex r : graph.runs.indices()) AddMotions(graph.runs[r], r);
  AddObservations(graph, weighting);
  for (const RunIndex r : graph.runs.indices()) AddCalibrationPriors(graph.runs[r], r);
  for (const GraphPrior& prior : graph.priors) AddPrior(prior);
  if (graph.priors.empty()) {
    double* anchor = poses_[graph.anchor_run].front().data();
    problem_.SetParameterBlockConstant(anchor);
    anchor_ = anchor;
  }
}

void CeresProblem::AddMotions(const GraphRun& run, RunIndex index) {
  auto& poses = poses_[index];
  for (const FrameIndex i : run.motions.indices()) {
    residuals_.push_back(
        problem_.AddResidualBlock(new MotionCost(run.motions[i], run.variance_factor),
                                  nullptr,
                                  poses[i].data(),
                                  poses[i + 1].data(),
                                  corrections_[index].data(),
                                  biases_[index].data()));
  }
}

void CeresProblem::AddCalibrationPriors(const GraphRun& run, RunIndex index) {
  const Eigen::Matrix3d sqrt_information = run.correction_prior_sd.cwiseInverse().asDiagonal();
  residuals_.push_back(
      problem_.AddResidualBlock(new ceres::NormalPrior(sqrt_information, run.correction_prior_mean),
                                nullptr,
                                corrections_[index].data()));
  const Eigen::Matrix3d bias_sqrt_information = run.sensor_bias_sd.cwiseInverse().asDiagonal();
  residuals_.push_back(
      problem_.AddResidualBlock(new ceres::NormalPrior(bias_sqrt_information, SensorBias::Zero()),
                                nullptr,
                                biases_[index].data()));
}

void CeresProblem::AddObservations(const Graph& graph, Weighting weighting) {
  const IndexedVector<RunIndex, RobustLoss> losses = LossesOf(graph);
  for (const GraphObservation& item : graph.observations) {
    residuals_.push_back(problem_.AddResidualBlock(new ObservationCost(item),
                                                   new ObservationLoss(losses[item.run], weighting),
                                                   poses_[item.run][item.frame].data(),
                                                   modes_[item.mode].data(),
                                                   biases_[item.run].data()));
  }
}

void CeresProblem::AddPrior(const GraphPrior& prior) {
  std::vector<double*> blocks;
  for (const ModeIndex mode : prior.modes) blocks.push_back(modes_[mode].data());
  residuals_.push_back(problem_.AddResidualBlock(new ModesPriorCost(prior), nullptr, blocks));
}

std::optional<Eigen::SparseMatrix<double, Eigen::RowMajor>> CeresProblem::Jacobian() {
  ceres::Problem::EvaluateOptions options;
  options.residual_blocks = residuals_;
  for (auto& poses : poses_) {
    for (auto& pose : poses) {
      if (pose.data() != anchor_) options.parameter_blocks.push_back(pose.data());
    }
  }
  for (const RunIndex r : poses_.indices()) {
    options.parameter_blocks.push_back(corrections_[r].data());
    options.parameter_blocks.push_back(biases_[r].data());
  }
  for (auto& mode : modes_) options.parameter_blocks.push_back(mode.data());
  ceres::CRSMatrix crs;
  if (!problem_.Evaluate(options, nullptr, nullptr, nullptr, &crs)) return std::nullopt;
  const bool finite = std::all_of(
      crs.values.begin(), crs.values.end(), [](double value) { return std::isfinite(value); });
  if (!finite) return std::nullopt;
  return Eigen::Map<const Eigen::SparseMatrix<double, Eigen::RowMajor>>(crs.num_rows,
                                                                        crs.num_cols,
                                                                        std::ssize(crs.values),
                                                                        crs.rows.data(),
                                                                        crs.cols.data(),
                                                                        crs.values.data());
}

void CeresProblem::CopyTo(Graph* graph) const {
  for (const RunIndex r : poses_.indices()) {
    GraphRun& run = graph->runs[r];
    run.correction = Eigen::Map<const Eigen::Vector3d>(corrections_[r].data());
    run.sensor_bias = Eigen::Map<const SensorBias>(biases_[r].data());
    for (const FrameIndex i : run.poses.indices()) {
      run.poses[i] = PoseFromParameters(poses_[r][i].data());
    }
  }
  for (const ModeIndex m : modes_.indices()) graph->modes[m] = {modes_[m][0], modes_[m][1]};
}

}  // namespace shiftmap
