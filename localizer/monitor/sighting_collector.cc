// SPDX-License-Identifier: Apache-2.0
#include "localizer/monitor/sighting_collector.h"

#include <algorithm>

#include "localizer/filter/unknown_places.h"
#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

constexpr std::size_t kMaxPlaces = 32;

// Chi-square quantile of 0.999 with 2 degrees of freedom.
constexpr double kSamePlace = 13.8;

}  // namespace

SightingCollector::PlaceState SightingCollector::Add(const Signature& signature,
                                                     const Eigen::Vector2d& p_map,
                                                     const Eigen::Matrix2d& cov,
                                                     const Eigen::Vector2d& p_map_vehicle,
                                                     Stamp stamp) {
  std::vector<Place>& places = places_[signature];
  for (std::size_t i = 0; i < places.size(); ++i) {
    Place& place = places[i];
    UnmappedSighting& sighting = place.sighting;
    const Eigen::Vector2d d = p_map - sighting.p_map_landmark;
    if (SquaredMahalanobis(d, sighting.cov_p_map_landmark + cov) > kSamePlace) continue;
    ++sighting.count;
    const double share = 1.0 / static_cast<double>(sighting.count);
    sighting.p_map_landmark += share * d;
    // Sightings of one pass share the pose's error, so the mean is as uncertain as each of them.
    sighting.cov_p_map_landmark += share * (cov - sighting.cov_p_map_landmark);
    sighting.last = stamp;
    place.from_apart |= (p_map_vehicle - place.p_map_first_vehicle).norm() > kApart;
    return {i,
            sighting.count,
            sighting.p_map_landmark,
            sighting.first,
            sighting.last,
            place.from_apart,
            place.confirmed};
  }
  if (places.size() == kMaxPlaces) {
    places.erase(std::min_element(places.begin(), places.end(), [](const Place& a, const Place& b) {
      return a.sighting.count < b.sighting.count;
    }));
  }
  places.push_back({{signature, p_map, cov, 1, stamp, stamp}, p_map_vehicle, false, false});
  return {places.size() - 1, 1, p_map, stamp, stamp, false, false};
}

void SightingCollector::Confirm(const Signature& signature, std::size_t place) {
  places_.at(signature).at(place).confirmed = true;
}

void SightingCollector::ForgetSince(Stamp stamp) {
  for (auto& [signature, places] : places_) {
    std::erase_if(places, [&](const Place& place) { return place.sighting.first >= stamp; });
  }
}

std::vector<UnmappedSighting> SightingCollector::Sightings() const {
  std::vector<UnmappedSighting> all;
  for (const auto& [signature, places] : places_) {
    for (const Place& place : places) all.push_back(place.sighting);
  }
  return all;
}

}  // namespace shiftmap
