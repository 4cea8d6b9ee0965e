// SPDX-License-Identifier: Apache-2.0
#include "mapper/selection/forward_backward.h"

#include "localizer/hypothesis/log_math.h"
#include "mapper/selection/per_step.h"
#include "proto/core/check.h"

namespace shiftmap {
namespace {

// T x n: log a_t(k).
Eigen::MatrixXd LogForward(const ModeSequenceProblem& problem) {
  CheckModeSequence(problem);
  const Eigen::Index steps = problem.log_likelihood.rows();
  const Eigen::Index n = problem.log_initial.size();
  Eigen::MatrixXd forward(steps, n);
  forward.row(0) = problem.log_initial.transpose() + problem.log_likelihood.row(0);
  for (Eigen::Index t = 1; t < steps; ++t) {
    const Eigen::MatrixXd& transition = problem.log_transition[static_cast<std::size_t>(t) - 1];
    for (Eigen::Index to = 0; to < n; ++to) {
      forward(t, to) = LogSumExp(forward.row(t - 1).transpose() + transition.col(to)) +
                       problem.log_likelihood(t, to);
    }
  }
  SHIFTMAP_CHECK(
      forward.row(steps - 1).maxCoeff() > kLogZero, "no sequence of {} steps is possible", steps);
  return forward;
}

}  // namespace

ModePosteriors SmoothModes(const ModeSequenceProblem& problem) {
  const Eigen::MatrixXd forward = LogForward(problem);
  const Eigen::Index steps = forward.rows();
  const Eigen::Index n = forward.cols();
  ModePosteriors result;
  result.log_evidence = LogSumExp(forward.row(steps - 1).transpose());
  result.probabilities.resize(steps, n);
  Eigen::VectorXd backward = Eigen::VectorXd::Zero(n);
  for (Eigen::Index t = steps - 1; t >= 0; --t) {
    const Eigen::VectorXd log_posterior = forward.row(t).transpose() + backward;
    result.probabilities.row(t) =
        (log_posterior.array() - LogSumExp(log_posterior)).exp().transpose();
    if (t == 0) break;
    const Eigen::MatrixXd& transition = problem.log_transition[static_cast<std::size_t>(t) - 1];
    const Eigen::VectorXd ahead = problem.log_likelihood.row(t).transpose() + backward;
    for (Eigen::Index from = 0; from < n; ++from) {
      backward[from] = LogSumExp(transition.row(from).transpose() + ahead);
    }
  }
  return result;
}

Eigen::MatrixXd ForwardPosteriors(const ModeSequenceProblem& problem) {
  Eigen::MatrixXd posteriors = LogForward(problem);
  for (Eigen::Index t = 0; t < posteriors.rows(); ++t) {
    const double log_evidence = LogSumExp(posteriors.row(t).transpose());
    posteriors.row(t) = (posteriors.row(t).array() - log_evidence).exp();
  }
  return posteriors;
}

}  // namespace shiftmap
