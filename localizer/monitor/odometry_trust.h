// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>

#include "mapstore/geometry/covariance.h"
#include "mapstore/geometry/se2.h"

namespace shiftmap {

/// Whether odometry is trusted. Where landmarks have shown that it is wrong, as with a gyro that is
/// dead, it would make the next pose wrong too. So it is trusted again only when landmarks have
/// shown a motion of a metre and half a radian that it agrees with, or a longer way.
class OdometryTrust {
 public:
  bool trusted() const { return trusted_; }

  /// Odometry is wrong.
  void Distrust();

  /// The pose is another one.
  void Restart() { begin_.reset(); }

  /// @param T_begin_end  By odometry, since the last call.
  void Move(const Se2& T_begin_end);

  /// By these motions landmarks that were seen on the way stand where the map has them.
  void Agree(std::span<const Se2> motions);

  /// Landmarks determine the pose, after the last motion. One that is vague says nothing.
  void Compare(const PoseWithCovariance& pose);

 private:
  struct Determined {
    Se2 T_map_vehicle;
    double sd_m = 0.0;
    double sd_rad = 0.0;
  };

  void BeginAt(const Determined& pose);

  bool trusted_ = true;
  std::optional<Determined> begin_;  // Since when both agree; nothing: they do not yet.
  Se2 T_begin_vehicle_;              // By odometry.
  double way_m_ = 0.0;               // That odometry has counted.
  double turn_rad_ = 0.0;
  bool has_shown_way_ = false;
  bool has_shown_turn_ = false;
};

}  // namespace shiftmap
