// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <boost/container/static_vector.hpp>

#include "localizer/filter/shared_errors.h"
#include "mapstore/run/run.h"

namespace shiftmap {

/// A landmark seen nearer to a mode than this does not count as moved: map or pose may be less
/// exact than they say. [m]
inline constexpr double kMinDisplacement = 0.2;

/// What is seen from viewpoints nearer to each other may be one outlier view, repeated. [m]
inline constexpr double kApart = 0.5;

/// Where a landmark stands that is at none of its modes, as a filter's own pose puts it.
///
/// Its error p̃ shares what the pose (error x̃) and the sensor's bias b had wrong when the landmark
/// was seen there, so that later sightings from the same trajectory need not count that again.
struct UnknownPlace {
  using StateByPoint = SharedErrors::StateByPoint;

  int group = 0;                                             ///< Index into MapSnapshot::groups().
  Eigen::Vector2d p_map_landmark = Eigen::Vector2d::Zero();  ///< [m]

  /// The point whose error SharedErrors estimates, if it knows of the place. [m]
  Eigen::Vector2d p_shared = Eigen::Vector2d::Zero();

  /// Of the first sighting, by dead reckoning: a pose that is corrected has not moved. [m]
  Eigen::Vector2d p_odom_viewpoint = Eigen::Vector2d::Zero();

  Eigen::Matrix2d cov = Eigen::Matrix2d::Zero();           ///< E[p̃ p̃ᵀ]. [m²]
  StateByPoint cross_state = StateByPoint::Zero();         ///< E[x̃ p̃ᵀ].
  Observation::Kind kind = Observation::Kind::kCartesian;  ///< Of the bias in cross_bias.
  Eigen::Matrix2d cross_bias = Eigen::Matrix2d::Zero();    ///< E[b p̃ᵀ].

  /// Of the bias of one kind of observation: those of different kinds share none.
  Eigen::Matrix2d CrossBias(Observation::Kind of) const {
    return of == kind ? cross_bias : Eigen::Matrix2d::Zero();
  }
};

/// The unknown places of one filter, at most one per group. Without heap allocations: the one that
/// was not used for longest makes room.
class UnknownPlaces {
 public:
  static constexpr std::size_t kMaxPlaces = 16;

  /// Null if there is none. Valid until the next call that is not const.
  const UnknownPlace* Find(int group) const;

  /// Puts a place in, or in the place of the group's last.
  void Put(const UnknownPlace& place);
  void Erase(int group);

  auto begin() { return places_.begin(); }
  auto end() { return places_.end(); }

 private:
  boost::container::static_vector<UnknownPlace, kMaxPlaces> places_;  // Last used last.
};

}  // namespace shiftmap
