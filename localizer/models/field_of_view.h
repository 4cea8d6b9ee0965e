// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "localizer/models/scan_polygon.h"
#include "mapstore/core/stamp.h"
#include "mapstore/geometry/se2.h"
#include "mapstore/map/calibration.h"
#include "mapstore/run/lidar_scan.h"

namespace shiftmap {

enum class FieldOfViewModel {
  kSector,       ///< Of the sensor's calibration, IJRR 7.2.
  kScanPolygon,  ///< The part of it that a lidar's scan covers, T-IV IX-D.
};

/// Names on command lines, e.g. "scan-polygon", by model.
const std::vector<std::string>& FieldOfViewNames();
/// Precondition: one of the names.
FieldOfViewModel FieldOfViewNamed(const std::string& name);

struct FieldOfViewOptions {
  FieldOfViewModel model = FieldOfViewModel::kSector;

  /// An older scan says nothing of what is occluded now, > 0. Larger bridges a slower lidar, and
  /// people walk farther meanwhile. [s]
  double max_lidar_age_s = 0.5;

  ScanPolygonOptions polygon = {};
};

/// Where the sensor sees landmarks at a time: P_FOV by one of two models.
///
/// The sector is what the sensor reaches. With kScanPolygon P_FOV is that of the sector times the
/// share of the polygon of the last scan at or before the time, as the sensor that detects
/// landmarks may reach less far than the lidar. Without a scan, or with an old one, the sector
/// counts alone. So a bound on the sector's holds for both.
///
/// Memory: that of the largest scan, reused. Threads: const-safe.
class FieldOfView {
 public:
  FieldOfView(const SensorCalibration& sensor, const FieldOfViewOptions& options);

  /// A lidar's scan. Nothing with kSector.
  /// @param scan  Valid by ValidateEvent(), not older than the one before.
  void Take(const LidarScan& scan);

  /// The vehicle drove from `begin` on for `elapsed_s`: the area is seen from where it is then. To
  /// be called in the order of time; a scan inside the stretch moves on by its share of it.
  void Move(const Se2& T_begin_end, Stamp begin, double elapsed_s);

  /// What is asked from now on is of this time.
  void Look(Stamp stamp);

  /// Lets go of the scan.
  void Forget() { lidar_.reset(); }

  /// True if a scan counts now.
  bool by_lidar() const { return by_lidar_; }

  /// P_FOV, in [0, 1].
  /// @param q      Expected place of a landmark, vehicle frame. [m]
  /// @param cov_q  Under the uncertainty of pose and landmark. [m²]
  /// @return 0 if a value is NaN.
  double Probability(const Eigen::Vector2d& q, const Eigen::Matrix2d& cov_q) const;

  /// True if a point is in view whatever the uncertainty of the pose: clear of all limits, and not
  /// too near.
  /// @param q  Vehicle frame. [m]
  bool WellInView(const Eigen::Vector2d& q) const;

 private:
  SensorCalibration sensor_;
  FieldOfViewOptions options_;
  ScanPolygonShare share_;
  ScanPolygon polygon_;
  std::optional<Stamp> lidar_;  // Of the scan that polygon_ is of.
  bool by_lidar_ = false;
};

}  // namespace shiftmap
