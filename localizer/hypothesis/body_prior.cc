// SPDX-License-Identifier: Apache-2.0
#include "localizer/hypothesis/body_prior.h"

#include <cmath>

#include "mapstore/geometry/covariance.h"
#include "mapstore/map/main_mode.h"

namespace shiftmap {
namespace {

// What a body's landmarks keep of their places in it, standard deviation per axis. [m]
constexpr double kRigidSd = 0.1;

// Turns of a body, standard deviations. [rad]
constexpr double kUnturnedSd = 0.02;
constexpr double kTurnedSd = 0.3;

// Share of bodies that are not turned.
constexpr double kUnturnedShare = 0.5;

// Where a landmark most probably stood when the map was made.
const Mode& ModeBefore(const MapSnapshot& snapshot, int group) {
  const LandmarkGroup& landmark = snapshot.groups()[static_cast<std::size_t>(group)];
  return landmark.modes[MainMode(landmark)];
}

// Where a landmark is that goes along with another one.
UnknownPlace Along(const Mode& from,
                   const Mode& other_from,
                   const UnknownPlace& other,
                   double sd_turn) {
  const Eigen::Vector2d apart = from.p_map_landmark - other_from.p_map_landmark;
  const Eigen::Vector2d across = sd_turn * Eigen::Vector2d(-apart.y(), apart.x());
  UnknownPlace place = other;
  place.p_map_landmark += apart;
  place.cov += from.cov_p_map_landmark + other_from.cov_p_map_landmark +
               kRigidSd * kRigidSd * Eigen::Matrix2d::Identity() + across * across.transpose();
  return place;
}

}  // namespace

double DensityWithOthers(const MapSnapshot& snapshot,
                         const KnownMapFilter& filter,
                         int group,
                         const KnownMapFilter::Measurement& measurement,
                         const MovedLandmarks& moved) {
  const Mode& from = ModeBefore(snapshot, group);
  double sum = 0.0;
  double others = 0.0;
  for (const MovedLandmark& other : moved) {
    if (other.place->group == group) continue;
    const Mode& other_from = ModeBefore(snapshot, other.place->group);
    const auto along = [&](double sd_turn) {
      const KnownMapFilter::Prediction prediction =
          filter.PredictPlace(Along(from, other_from, *other.place, sd_turn), measurement);
      return prediction.usable() ? std::exp(LogGaussian(prediction.nu, prediction.S)) : 0.0;
    };
    others += other.probability;
    sum += other.probability *
           (kUnturnedShare * along(kUnturnedSd) + (1.0 - kUnturnedShare) * along(kTurnedSd));
  }
  return sum / (others + 1.0);
}

}  // namespace shiftmap
