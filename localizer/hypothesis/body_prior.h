// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/container/static_vector.hpp>

#include "localizer/filter/known_map_filter.h"

namespace shiftmap {

/// A landmark that a leaf holds at an unknown place.
struct MovedLandmark {
  const UnknownPlace* place = nullptr;
  double probability = 0.0;  ///< That it stands there.
};
using MovedLandmarks = boost::container::static_vector<MovedLandmark, UnknownPlaces::kMaxPlaces>;

/// Where a landmark is seen first that moved as others did, as a density of positions, times the
/// probability that it did so. [1/m²]
///
/// Landmarks that stand on one rack, or are displaced together, move as one rigid body. Then one
/// motion explains all of them, and without it another pose would seem likelier than as many moves,
/// each by itself. A landmark goes along with the n others that moved with probability n / (n + 1);
/// of bodies half are not turned, and half by any small angle.
/// @param group        Index into MapSnapshot::groups().
/// @param measurement  Of the landmark.
/// @param moved        Others, at most one per group.
double DensityWithOthers(const MapSnapshot& snapshot,
                         const KnownMapFilter& filter,
                         int group,
                         const KnownMapFilter::Measurement& measurement,
                         const MovedLandmarks& moved);

}  // namespace shiftmap
