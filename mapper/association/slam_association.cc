// SPDX-License-Identifier: Apache-2.0
#include "mapper/association/slam_association.h"

#include <cmath>
#include <utility>

#include "localizer/models/observation_model.h"
#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

// Standard deviations of the pose that a landmark's place is looked for in.
constexpr double kReachSd = 4.0;

constexpr double kLandmarkSlack = 5.0;  // [m]

}  // namespace

double PlaceSlack(const SlamState& state, double range_m) {
  const Eigen::Matrix3d P = state.PoseCovariance();
  return kReachSd * (std::sqrt(P(0, 0) + P(1, 1)) + std::sqrt(P(2, 2)) * range_m) + kLandmarkSlack;
}

SlamAssociation AssociateLandmarks(const Scan& scan,
                                   std::span<const int> observations,
                                   std::span<const int> landmarks,
                                   double slack_m,
                                   AssociationMethod method,
                                   const CompatibilityOptions& options,
                                   const SlamState& state) {
  const double gate = ChiSquareQuantile(options.gate_probability, 2);
  CompatibilityProblem problem;
  problem.observations = static_cast<int>(observations.size());
  std::vector<SlamPair> candidates;
  for (std::size_t i = 0; i < observations.size(); ++i) {
    const Observation& observation = scan.observations[static_cast<std::size_t>(observations[i])];
    const Eigen::Vector2d p = LandmarkPosition(observation, state.pose());
    for (const int landmark : landmarks) {
      if ((state.Position(landmark) - p).norm() > slack_m) continue;
      const SlamPair pair{landmark, &observation};
      Eigen::Matrix2d S;
      if (SquaredMahalanobis(state.Linearized(pair, &S).nu, S) > gate) continue;
      problem.candidates.push_back({static_cast<int>(i), landmark});
      candidates.push_back(pair);
    }
  }
  SlamAssociation found;
  if (candidates.empty()) {
    found.left.assign(observations.begin(), observations.end());
    return found;
  }
  JointInnovation joint = state.Innovate(candidates);
  problem.nu = std::move(joint.nu);
  problem.covariance = std::move(joint.S);
  const JointAssociation association = method == AssociationMethod::kJoint
                                           ? AssociateJointly(problem, options)
                                           : AssociateNearest(problem, options);
  found.complete = association.complete;
  for (std::size_t i = 0; i < observations.size(); ++i) {
    const int candidate = association.candidates[i];
    if (candidate < 0) {
      found.left.push_back(observations[i]);
      continue;
    }
    found.pairs.push_back(candidates[static_cast<std::size_t>(candidate)]);
    found.paired.push_back(observations[i]);
  }
  return found;
}

}  // namespace shiftmap
