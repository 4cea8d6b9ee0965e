// SPDX-License-Identifier: Apache-2.0
#include "mapper/covariance/map_prior.h"

#include "mapper/covariance/gauge.h"

namespace shiftmap {
std::vector<GraphPrior> MakeMapPrior(const IndexedVector<ModeIndex, Eigen::Vector2d>& positions,
                                     const JointCovariance& cov) {
  std::vector<GraphPrior> priors;
  if (cov.size() == 0) return priors;
  const std::vector<std::vector<int>> sets = cov.JointSets();
  for (const std::vector<int>& set : sets) {
    const std::vector<ModeIndex> modes(set.begin(), set.end());
    std::vector<Eigen::Vector2d> of_modes;
    for (const ModeIndex mode : modes) of_modes.push_back(positions[mode]);
    const Eigen::MatrixXd joint = cov.Dense(set);
    priors.push_back(sets.size() == 1 ? MakeGraphPrior(modes, of_modes, joint)
                                      : MakeLocatedPrior(modes, of_modes, joint));
  }
  return priors;
}

}  // namespace shiftmap
