// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "localizer/models/detection_model.h"
#include "localizer/models/own_field_of_view.h"
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

  /// Largest age of a lidar scan at an observation, > 0. A larger age serves a slower lidar, but
  /// moving obstacles go farther in that time. [s]
  double max_lidar_age_s = 0.5;

  /// Silence counts where the vehicle itself has seen landmarks (OwnFieldOfView); false: wherever
  /// the map's sensor reaches, as if all vehicles had it.
  bool own = true;
};

/// The last scan of a lidar, as seen from where the vehicle is now.
struct LidarView {
  bool counts = false;  ///< For now; false: there is no scan, or it is too old.
  LidarScan scan;
  Se2 T_scan_now;  ///< The way that the vehicle drove since.

  /// Another scan came. Memory: reuses its own.
  void Take(const LidarScan& newer);

  /// The vehicle drove on for `elapsed_s` until `now`. A scan of in between moves by its share.
  void Move(const Se2& T_begin_end, double elapsed_s, Stamp now, double max_age_s);
};

/// P_FOV of a place, each in [0, 1].
struct InViewProbability {
  double sensor = 0.0;  ///< Of the map's sensor: what is seen was in its view.
  double own = 0.0;  ///< Of what the vehicle itself sees, too: only here silence tells. <= sensor.
};

/// Where the sensor sees landmarks at a time: P_FOV by one of two models.
///
/// The sector is what the sensor reaches. With a lidar's scan P_FOV is that of the sector times the
/// share of the scan's polygon, as the sensor that detects landmarks may reach less far than the
/// lidar; without one the sector counts alone. So a bound on the sector's holds for both.
///
/// Memory: that of the largest scan, reused. Threads: const-safe.
class FieldOfView {
 public:
  /// @param own  As FieldOfViewOptions::own.
  explicit FieldOfView(const SensorCalibration& sensor, bool own = true)
      : sensor_(SectorOf(sensor)), learns_(own), seen_(sensor) {
    if (!own) own_ = sensor_;
  }

  /// What is asked from now on is of the time of this view. The polygon of a scan is made once.
  /// @param lidar  Its scan is valid by ValidateEvent(). Null: no lidar.
  void Look(const LidarView* lidar);

  /// The vehicle saw a landmark of the map, wherever that stands now, from another place than
  /// before.
  /// @param q  Vehicle frame. [m]
  void Saw(const Eigen::Vector2d& q);

  /// @param q      Expected place of a landmark, vehicle frame. [m]
  /// @param cov_q  Under the uncertainty of pose and landmark. [m²]
  /// @return 0 if a value is NaN.
  InViewProbability Probability(const Eigen::Vector2d& q, const Eigen::Matrix2d& cov_q) const;

  /// True if a point is in the vehicle's own view whatever the uncertainty of the pose: clear of
  /// all limits, and not too near.
  /// @param q  Vehicle frame. [m]
  bool WellInView(const Eigen::Vector2d& q) const;

 private:
  Sector sensor_;
  bool learns_;
  OwnFieldOfView seen_;
  Sector own_;  // MakeSector() of it.
  ScanPolygonShare share_;
  ScanPolygon polygon_;
  std::optional<Stamp> polygon_stamp_;  // Of the scan that polygon_ is of.
  bool by_lidar_ = false;
};

}  // namespace shiftmap
