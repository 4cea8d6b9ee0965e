// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/incremental/observation_sequence.h"

#include "proto/core/check.h"

namespace shiftmap {
namespace {

// Logarithm of an n x n transition that leaves a state with the given probability.
Eigen::MatrixXd LogEvenTransition(Eigen::Index n, double change_probability) {
  // A single state cannot be left.
  if (n == 1) return Eigen::MatrixXd::Zero(1, 1);
  Eigen::MatrixXd transition =
      Eigen::MatrixXd::Constant(n, n, change_probability / static_cast<double>(n - 1));
  transition.diagonal().setConstant(1.0 - change_probability);
  return transition.array().log();
}

}  // namespace

ModeSequenceProblem MakeObservationSequence(const Eigen::VectorXd& initial,
                                            double change_probability,
                                            const std::vector<ObservationStep>& observations) {
  SHIFTMAP_CHECK(change_probability >= 0.0 && change_probability < 1.0,
                 "change probability {}",
                 change_probability);
  ModeSequenceProblem problem;
  problem.log_initial = initial.array().log();
  problem.log_likelihood.resize(static_cast<Eigen::Index>(observations.size()), initial.size());
  for (std::size_t t = 0; t < observations.size(); ++t) {
    const Eigen::ArrayXd detection = observations[t].detection_probability.array();
    const bool seen = observations[t].log_density.has_value();
    const Eigen::VectorXd log_likelihood =
        seen ? Eigen::VectorXd(detection.log() + observations[t].log_density->array())
             : Eigen::VectorXd((1.0 - detection).log());
    problem.log_likelihood.row(static_cast<Eigen::Index>(t)) = log_likelihood.transpose();
    problem.missed.push_back(!seen);
  }
  if (!observations.empty()) {
    problem.log_transition.assign(observations.size() - 1,
                                  LogEvenTransition(initial.size(), change_probability));
  }
  CheckModeSequence(problem);
  return problem;
}

}  // namespace shiftmap
