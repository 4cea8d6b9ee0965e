// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "mapstore/core/ids.h"
#include "mapstore/map/map_snapshot.h"

namespace shiftmap {

/// A mode of both maps that is not at the same place.
struct MovedMode {
  ModeNumber number;
  Eigen::Vector2d displacement_m = Eigen::Vector2d::Zero();  ///< To minus from, map frame. [m]

  /// Squared Mahalanobis distance of the displacement against the sum of both covariances, and the
  /// probability of at least that much by chance: chi-square with 2 degrees of freedom. The two
  /// estimates share data, so that the sum is on the safe side: what is significant is so indeed.
  double squared_mahalanobis = 0.0;
  double p_value = 1.0;
};

/// What is different about a landmark group that both maps have.
struct GroupDiff {
  Signature signature;
  std::vector<ModeNumber> added;    ///< By number, like the following.
  std::vector<ModeNumber> removed;  ///< Gone, and not merged.
  std::vector<MergedMode> merged;   ///< Modes of the first map that are part of others now.
  std::vector<MovedMode> moved;     ///< Any difference of the position.

  bool uncertainty_changed = false;  ///< The covariance of a mode of both maps.

  bool rates_changed = false;
  double from_move_rate_per_s = 0.0;  ///< MoveRate().
  double to_move_rate_per_s = 0.0;

  /// Half the sum over the states of the changes of probability; modes that only one map has count
  /// with the probability that they have there. In [0, 1].
  double probability_change = 0.0;

  bool empty() const {
    return added.empty() && removed.empty() && merged.empty() && moved.empty() &&
           !uncertainty_changed && !rates_changed && probability_change == 0.0;
  }
};

struct CalibrationChange {
  std::string vehicle;  ///< Whose; empty: the fleet's.
  std::string name;     ///< Of kCalibrationNames, or kVehicleValueNames.
  double from = 0.0;
  double to = 0.0;
};

/// What changed from one map to another. Modes are the same if signature and number are.
struct MapDiff {
  std::vector<Signature> groups_added;  ///< By signature, like the following.
  std::vector<Signature> groups_removed;
  std::vector<GroupDiff> groups;  ///< Those with any difference.
  int anonymous_from = 0;         ///< Number of anonymous landmarks.
  int anonymous_to = 0;
  bool anonymous_changed = false;           ///< Their number, or any of them.
  std::vector<std::string> vehicles_added;  ///< Calibrated by themselves; by name.
  std::vector<std::string> vehicles_removed;
  std::vector<CalibrationChange> calibration;  ///< The fleet's first, then by vehicle.

  bool empty() const {
    return groups_added.empty() && groups_removed.empty() && groups.empty() && !anonymous_changed &&
           vehicles_added.empty() && vehicles_removed.empty() && calibration.empty();
  }
};

MapDiff DiffMaps(const MapContent& from, const MapContent& to);

}  // namespace shiftmap
