// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/graph_problem.h"

#include <ceres/loss_function.h>
#include <ceres/normal_prior.h>

#include "mapper/graph/cost_functions.h"
#include "mapper/graph/robust_loss.h"

namespace shiftmap {
namespace {

ceres::Problem::Options ProblemOptions() {
  ceres::Problem::Options options;
  options.disable_all_safety_checks = true;
  return options;
}

// RobustLoss as Ceres takes it, which does without ρ'' where that is not positive.
class ObservationLoss final : public ceres::LossFunction {
 public:
  explicit ObservationLoss(const RobustLoss& loss) : loss_(loss) {}

  void Evaluate(double squared, double rho[3]) const override {
    rho[0] = 2.0 * loss_.HalfLoss(squared);
    rho[1] = loss_.Slope(squared);
    rho[2] = 0.0;
  }

 private:
  RobustLoss loss_;
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

GraphProblem::GraphProblem(const Graph& graph) : problem_(ProblemOptions()) {
  for (const Eigen::Vector2d& mode : graph.modes) modes_.push_back({mode.x(), mode.y()});
  for (const GraphRun& run : graph.runs) {
    corrections_.push_back({run.correction.x(), run.correction.y(), run.correction.z()});
    biases_.push_back({run.sensor_bias.x(), run.sensor_bias.y(), run.sensor_bias.z()});
    poses_.emplace_back();
    for (const Se2& pose : run.poses) poses_.back().push_back({pose.x(), pose.y(), pose.yaw()});
  }
  for (std::size_t i = 0; i < graph.runs.size(); ++i) AddRun(graph.runs[i], i);
  AddObservations(graph);
  if (graph.priors.empty()) {
    double* anchor = poses_[static_cast<std::size_t>(graph.anchor_run)].front().data();
    problem_.AddParameterBlock(anchor, 3);
    problem_.SetParameterBlockConstant(anchor);
  } else {
    for (const GraphPrior& prior : graph.priors) AddPrior(prior);
  }
}

void GraphProblem::AddRun(const GraphRun& run, std::size_t index) {
  std::vector<std::array<double, 3>>& poses = poses_[index];
  double* correction = corrections_[index].data();
  double* bias = biases_[index].data();
  for (std::size_t i = 0; i < run.motions.size(); ++i) {
    problem_.AddResidualBlock(new MotionCost(run.motions[i]),
                              nullptr,
                              poses[i].data(),
                              poses[i + 1].data(),
                              correction,
                              bias);
  }
  const Eigen::Matrix3d sqrt_information = run.correction_prior_sd.cwiseInverse().asDiagonal();
  problem_.AddResidualBlock(
      new ceres::NormalPrior(sqrt_information, run.correction_prior_mean), nullptr, correction);
  const Eigen::Matrix3d bias_sqrt_information = run.sensor_bias_sd.cwiseInverse().asDiagonal();
  problem_.AddResidualBlock(
      new ceres::NormalPrior(bias_sqrt_information, SensorBias::Zero()), nullptr, bias);
}

void GraphProblem::AddObservations(const Graph& graph) {
  for (const GraphObservation& item : graph.observations) {
    double* pose =
        poses_[static_cast<std::size_t>(item.run)][static_cast<std::size_t>(item.frame)].data();
    problem_.AddResidualBlock(new ObservationCost(item),
                              new ObservationLoss(RobustLoss(graph.loss_scale, graph.loss_reach)),
                              pose,
                              modes_[static_cast<std::size_t>(item.mode)].data(),
                              biases_[static_cast<std::size_t>(item.run)].data());
  }
}

void GraphProblem::AddPrior(const GraphPrior& prior) {
  std::vector<double*> blocks;
  for (const int mode : prior.modes)
    blocks.push_back(modes_[static_cast<std::size_t>(mode)].data());
  problem_.AddResidualBlock(new ModesPriorCost(prior), nullptr, blocks);
}

void GraphProblem::CopyTo(Graph* graph) const {
  for (std::size_t r = 0; r < poses_.size(); ++r) {
    GraphRun& run = graph->runs[r];
    run.correction = Eigen::Map<const Eigen::Vector3d>(corrections_[r].data());
    run.sensor_bias = Eigen::Map<const SensorBias>(biases_[r].data());
    for (std::size_t i = 0; i < poses_[r].size(); ++i)
      run.poses[i] = PoseFromParameters(poses_[r][i].data());
  }
  for (std::size_t m = 0; m < modes_.size(); ++m) graph->modes[m] = {modes_[m][0], modes_[m][1]};
}

}  // namespace shiftmap
