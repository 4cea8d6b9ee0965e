// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
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

/// The observations of a scan whose signature no other one has.
inline std::vector<const Observation*> IdentifiedOnce(const Scan& scan) {
  std::map<std::string, int> times;
  for (const Observation& observation : scan.observations) ++times[observation.signature.text()];
  std::vector<const Observation*> once;
  for (const Observation& observation : scan.observations) {
    const std::string& signature = observation.signature.text();
    if (!signature.empty() && times[signature] == 1) once.push_back(&observation);
  }
  return once;
}

}  // namespace shiftmap
