// SPDX-License-Identifier: Apache-2.0
#include "localizer/monitor/sighting_collector.h"

#include <algorithm>

#include "localizer/filter/unknown_places.h"
#include "localizer/filter/well_conditioned.h"
#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

constexpr std::size_t kMaxPlacesOfOne = 32;

// Chi-square quantile of 0.999 with 2 degrees of freedom.
constexpr double kSamePlace = 13.8;

}  // namespace

SightingCollector::PlaceState SightingCollector::Add(const Signature& signature,
                                                     const Eigen::Vector2d& p_map,
                                                     const Eigen::Matrix2d& cov,
                                                     const Eigen::Vector2d& p_odom_vehicle,
                                                     Stamp stamp) {
  const PlaceState seen_once{0, 1, p_map, stamp, stamp, false, false};
  const auto known = places_.find(signature);
  if (known == places_.end()) {
    if (!HasRoom()) return seen_once;
    places_[signature].push_back(
        {{signature, p_map, cov, 1, stamp, stamp}, p_odom_vehicle, false, false});
    return seen_once;
  }
  std::vector<Place>& places = known->second;
  for (std::size_t i = 0; i < places.size(); ++i) {
    Place& place = places[i];
    UnmappedSighting& sighting = place.sighting;
    const Eigen::Vector2d d = p_map - sighting.p_map_landmark;
    const Eigen::Matrix2d S = sighting.cov_p_map_landmark + cov;
    if (!IsWellConditioned(S) || SquaredMahalanobis(d, S) > kSamePlace) continue;
    ++sighting.count;
    const double share = 1.0 / static_cast<double>(sighting.count);
    sighting.p_map_landmark += share * d;
    // Sightings of one pass share the pose's error, so the mean is as uncertain as each of them.
    sighting.cov_p_map_landmark += share * (cov - sighting.cov_p_map_landmark);
    sighting.last = stamp;
    place.from_apart |= (p_odom_vehicle - place.p_odom_first_vehicle).norm() > kApart;
    return {i,
            sighting.count,
            sighting.p_map_landmark,
            sighting.first,
            sighting.last,
            place.from_apart,
            place.confirmed};
  }
  if (places.size() == kMaxPlacesOfOne) {
    places.erase(std::min_element(places.begin(), places.end(), [](const Place& a, const Place& b) {
      return a.sighting.count < b.sighting.count;
    }));
    --size_;
  }
  if (!HasRoom()) return seen_once;
  places.push_back({{signature, p_map, cov, 1, stamp, stamp}, p_odom_vehicle, false, false});
  return {places.size() - 1, 1, p_map, stamp, stamp, false, false};
}

// Counts what comes.
bool SightingCollector::HasRoom() {
  if (size_ == max_places_) {
    ++not_kept_;
    return false;
  }
  ++size_;
  return true;
}

void SightingCollector::Confirm(const Signature& signature, std::size_t place) {
  places_.at(signature).at(place).confirmed = true;
}

void SightingCollector::ForgetSince(Stamp stamp) {
  for (auto& [signature, places] : places_) {
    size_ -=
        std::erase_if(places, [&](const Place& place) { return place.sighting.first >= stamp; });
  }
  std::erase_if(places_, [](const auto& of_signature) { return of_signature.second.empty(); });
}

std::vector<UnmappedSighting> SightingCollector::Sightings() const {
  std::vector<UnmappedSighting> all;
  for (const auto& [signature, places] : places_) {
    for (const Place& place : places) all.push_back(place.sighting);
  }
  return all;
}

}  // namespace shiftmap
