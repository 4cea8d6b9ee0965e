// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <vector>

#include "mapstore/map/evidence.h"

namespace shiftmap {

/// Condenses observations that no mode explains into unmapped sightings, per signature and place.
///
/// Memory: bounded per signature; the place seen least makes room.
class SightingCollector {
 public:
  /// @param p_map, cov     Position and its covariance, pose error included. [m], [m²]
  /// @param p_map_vehicle  From where it was seen. [m]
  /// @return How often something was seen at this place by now, counting from when it had been
  ///         seen from half a metre apart: before that it may be one misjudged view, repeated.
  std::int64_t Add(const Signature& signature,
                   const Eigen::Vector2d& p_map,
                   const Eigen::Matrix2d& cov,
                   const Eigen::Vector2d& p_map_vehicle,
                   Stamp stamp);

  /// All of them, by signature, then time.
  std::vector<UnmappedSighting> Sightings() const;

 private:
  struct Place {
    UnmappedSighting sighting;
    Eigen::Vector2d p_map_first_vehicle = Eigen::Vector2d::Zero();
    bool from_apart = false;
  };

  std::map<Signature, std::vector<Place>> places_;
};

}  // namespace shiftmap
