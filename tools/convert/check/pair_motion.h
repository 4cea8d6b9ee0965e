// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <map>
#include <string>
#include <vector>

#include "mapstore/geometry/se2.h"
#include "mapstore/run/run.h"

namespace shiftmap {

/// How a landmark moves through the vehicle's view between two sightings p1 and p2: as it was seen,
/// and as it must if it stands and the vehicle moves by T. [m]
struct PairMotion {
  Eigen::Vector2d seen;      ///< p2 - p1
  Eigen::Vector2d expected;  ///< T⁻¹ p1 - p1

  double total() const { return seen.norm() + expected.norm(); }
  double misfit() const { return total() > 0.0 ? (seen - expected).norm() / total() : 0.0; }
};

/// Of each signature that stands at one place of a scan its first observation: a recorder may write
/// one twice.
inline std::vector<const Observation*> IdentifiedOnce(const Scan& scan) {
  constexpr double kOnePlaceM = 0.5;
  std::map<std::string, std::vector<const Observation*>> seen;
  for (const Observation& observation : scan.observations) {
    if (!observation.signature.anonymous())
      seen[observation.signature.text()].push_back(&observation);
  }
  std::vector<const Observation*> once;
  for (const auto& [signature, observations] : seen) {
    const Eigen::Vector2d first = observations.front()->PositionInVehicle();
    const bool one_place =
        std::all_of(observations.begin(), observations.end(), [&](const Observation* other) {
          return (other->PositionInVehicle() - first).norm() < kOnePlaceM;
        });
    if (one_place) once.push_back(observations.front());
  }
  return once;
}

}  // namespace shiftmap
