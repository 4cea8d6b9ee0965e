// SPDX-License-Identifier: Apache-2.0
//
// The area that a lidar's scan covers: a landmark behind a wall is not in view. FieldOfView,
// field_of_view.h, joins it with the sector model.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "mapstore/geometry/se2.h"
#include "mapstore/run/lidar_scan.h"

namespace shiftmap {

struct ScanPolygonOptions {
  /// Samples of a landmark's place, T-IV IX-D. The probability is a multiple of their inverse.
  int samples = 100;

  std::uint64_t seed = 1;
};

/// The area that a scan covers, as seen from the vehicle.
class ScanPolygon {
 public:
  /// Covers nothing.
  ScanPolygon() = default;

  /// @param border_lidar   What the beams hit, by strictly ascending bearing in [-π, π], lidar
  ///                       frame; for a beam without return where it could have hit. [m]
  /// @param all_round      The beams cover the full circle. If not, the sector behind the lidar,
  ///                       from the last beam to the first, is outside.
  /// @param grown_m        The area is grown by this away from the lidar.
  ScanPolygon(std::span<const Eigen::Vector2d> border_lidar,
              const Se2& T_vehicle_lidar,
              bool all_round,
              double grown_m);

  /// Takes the area of another scan, which is valid by ValidateEvent(). Memory: reuses its own.
  void Assign(const LidarScan& scan, double grown_m);

  /// Where the vehicle is, from where it was at the scan: at the same place until this is called.
  void SetVehicle(const Se2& T_scan_now) { T_lidar_now_ = T_lidar_vehicle_ * T_scan_now; }

  /// @param p_vehicle  Frame of the vehicle where it is. [m]
  bool Contains(const Eigen::Vector2d& p_vehicle) const;

  /// True if the area contains every point of a disc, false if none; nothing if that is not plain.
  /// @param p_vehicle  Its centre, in the same frame. [m]
  std::optional<bool> ContainsDisc(const Eigen::Vector2d& p_vehicle, double radius_m) const;

 private:
  void Add(double bearing_rad, const Eigen::Vector2d& p_lidar);
  // Goes once around.
  void Close();
  // The point behind a bearing, which is between those of the first point and the last.
  std::size_t Next(double bearing_rad) const;

  Se2 T_lidar_vehicle_;
  Se2 T_lidar_now_;
  std::vector<Eigen::Vector2d> border_;  // Lidar frame, grown.
  std::vector<double> bearings_;         // Of the border, ascending.
};

/// The share of samples of a landmark's place, as seen from the vehicle, that a scan covers: P_FOV
/// of T-IV IX-D. The paper samples pose and landmark, independent of each other; to first order the
/// place seen is their joint distribution, in which the filter knows their correlation as well.
/// The samples of every call come from the same draws, so that equal input gives equal output, and
/// close input close output.
class ScanPolygonShare {
 public:
  /// Precondition: samples >= 1.
  explicit ScanPolygonShare(const ScanPolygonOptions& options = {});

  /// @param q      Expected place, vehicle frame. [m]
  /// @param cov_q  Under the uncertainty of pose and landmark. [m²]
  /// @return 0 if a value is NaN.
  double operator()(const ScanPolygon& polygon,
                    const Eigen::Vector2d& q,
                    const Eigen::Matrix2d& cov_q) const;

 private:
  std::vector<Eigen::Vector2d> draws_;  // Standard normal.
  double longest_draw_ = 0.0;
};

}  // namespace shiftmap
