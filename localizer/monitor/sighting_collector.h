// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <vector>

#include "mapstore/map/evidence.h"

namespace shiftmap {

/// Condenses observations that no mode explains into unmapped sightings, per signature and place.
///
/// Memory: at most `max_places`; what is beyond is counted and not kept. A signature has at most
/// 32, of which the one seen least makes room.
class SightingCollector {
 public:
  /// @param max_places  >= 1.
  explicit SightingCollector(int max_places) : max_places_(static_cast<std::size_t>(max_places)) {}

  /// What is known by now of the place where something was seen.
  struct PlaceState {
    std::size_t place = 0;   ///< Valid until the next Add() of the signature.
    std::int64_t count = 0;  ///< Sightings.
    Eigen::Vector2d p_map = Eigen::Vector2d::Zero();  ///< Mean of the sightings. [m]
    Stamp first;
    Stamp last;
    bool from_apart = false;  ///< From half a metre apart: not one outlier view, repeated.
    bool confirmed = false;   ///< By Confirm().
  };

  /// @param p_map, cov     Position and its covariance, pose error included. [m], [m²]
  /// @param p_odom_vehicle  From where it was seen, by dead reckoning. [m]
  PlaceState Add(const Signature& signature,
                 const Eigen::Vector2d& p_map,
                 const Eigen::Matrix2d& cov,
                 const Eigen::Vector2d& p_odom_vehicle,
                 Stamp stamp);

  /// Takes a place for the one where the landmark stands now.
  void Confirm(const Signature& signature, std::size_t place);

  /// Drops the places found at `stamp` or later: the pose was wrong then.
  void ForgetSince(Stamp stamp);

  /// Observations at places that were not kept.
  std::int64_t not_kept() const { return not_kept_; }

  /// All of them, by signature, then time.
  std::vector<UnmappedSighting> Sightings() const;

 private:
  struct Place {
    UnmappedSighting sighting;
    Eigen::Vector2d p_odom_first_vehicle = Eigen::Vector2d::Zero();
    bool from_apart = false;
    bool confirmed = false;
  };

  bool HasRoom();

  std::map<Signature, std::vector<Place>> places_;
  std::size_t max_places_;
  std::size_t size_ = 0;  // Places of all signatures.
  std::int64_t not_kept_ = 0;
};

}  // namespace shiftmap
