// SPDX-License-Identifier: Apache-2.0
#include "mapper/selection/visit_sequence.h"

#include <limits>
#include <utility>

namespace shiftmap {

ModeSequenceProblem MakeVisitSequence(Eigen::VectorXd log_initial,
                                      const ModeChain& chain,
                                      const std::vector<VisitStep>& visits) {
  ModeSequenceProblem problem;
  problem.log_initial = std::move(log_initial);
  problem.log_likelihood.resize(static_cast<Eigen::Index>(visits.size()), chain.states());
  for (std::size_t t = 0; t < visits.size(); ++t) {
    problem.log_likelihood.row(static_cast<Eigen::Index>(t)) = visits[t].log_likelihood.transpose();
    if (t == 0) continue;
    // What the chain rules out stays possible, at a price that no rounding error can pay.
    problem.log_transition.push_back(chain.Transition(visits[t - 1].end, visits[t].begin)
                                         .array()
                                         .max(std::numeric_limits<double>::min())
                                         .log()
                                         .matrix());
  }
  CheckModeSequence(problem);
  return problem;
}

}  // namespace shiftmap
