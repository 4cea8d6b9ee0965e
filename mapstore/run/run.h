// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <functional>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "mapstore/core/ids.h"
#include "mapstore/core/stamp.h"
#include "mapstore/run/lidar_scan.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Velocity of the vehicle in its own frame, as its odometry measured it from `stamp` on.
struct OdometrySample {
  Stamp stamp;
  double v_mps = 0.0;        ///< Forward. [m/s]
  double omega_radps = 0.0;  ///< Counter-clockwise. [rad/s]
};

/// One landmark seen in one scan.
struct Observation {
  enum class Kind {
    kRangeBearing,  ///< z = (range [m] > 0, bearing [rad], counter-clockwise from vehicle x).
    kCartesian,     ///< z = position in the vehicle frame (x, y) [m], T-IV (29).
  };

  Signature signature;  ///< Empty if the landmark has none.
  Kind kind = Kind::kRangeBearing;
  Eigen::Vector2d z = Eigen::Vector2d::Zero();
  /// Covariance of z in its own units, if the log states one; otherwise the sensor's calibration
  /// holds.
  std::optional<Eigen::Matrix2d> cov_z;

  /// Position of the landmark in the vehicle frame. [m]
  Eigen::Vector2d PositionInVehicle() const;
};

/// Everything seen in one scan; may be empty, which says that the sensor looked and saw nothing.
struct Scan {
  Stamp stamp;
  std::vector<Observation> observations;
};

/// Where a run comes from.
struct RunInfo {
  std::string vehicle;
  std::string source;     ///< E.g. "utias MRCLAM_Dataset1 robot 1".
  std::string uuid = {};  ///< Of the run, drawn when its log began; empty if the log has none.
  std::string area = {};  ///< That the run is in; empty if the log does not say.
};

/// One vehicle's recorded log.
struct Run {
  RunInfo info;
  std::vector<OdometrySample> odometry;  ///< By non-decreasing stamp.
  std::vector<Scan> scans;               ///< By non-decreasing stamp.
  /// By non-decreasing stamp; of one lidar. Most logs have none.
  std::vector<LidarScan> lidar_scans = {};
};

/// The first and the last stamp of odometry and scans: a log may begin and end with either.
/// Precondition: there is odometry.
Stamp BeginOf(const Run& run);
Stamp EndOf(const Run& run);

/// One item of a run in the order of time, as a live vehicle delivers it. By index as they come
/// where stamps are equal.
using RunEvent = std::variant<OdometrySample, LidarScan, Scan>;

inline Stamp StampOf(const RunEvent& event) {
  return std::visit([](const auto& item) { return item.stamp; }, event);
}

/// Checks one item by itself: a stamp within 146 years of 1970, numbers within ±1e9, range > 0,
/// covariance positive definite; a lidar's ranges in [0, 10 km], 2 to 10,000 of them. Errors:
/// kInvalidArgument with the stamp and the value.
Status ValidateEvent(const RunEvent& event);

/// Checks a whole run: every item, stamps that do not go backwards, at least one odometry sample.
/// Errors: kInvalidArgument, naming the first item that is wrong.
Status ValidateRun(const Run& run);

/// Gives the items of all streams by stamp; where stamps are equal odometry is first, then the
/// lidar's scan, so that it holds for what was seen at its time.
/// Errors: the first of `take`, which ends it.
Status ForEachEvent(const Run& run, const std::function<Status(const RunEvent&)>& take);

/// The same items, copied.
std::vector<RunEvent> MergeEvents(const Run& run);

}  // namespace shiftmap
