// SPDX-License-Identifier: Apache-2.0
#include "localizer/models/field_of_view.h"

#include <algorithm>
#include <cmath>

#include "proto/core/check.h"

namespace shiftmap {
namespace {

// The bearing of a nearer point is undefined. [m]
constexpr double kMinRange = 1e-3;

// The area that a scan covers is grown by this away from the lidar, T-IV IX-D: landmarks are on
// what the beams hit, so that without it half of the samples of a landmark in plain view fall
// outside. [m]
constexpr double kGrownM = 0.5;

Eigen::Vector2d RangeBearing(const Eigen::Vector2d& q) {
  return {std::max(q.norm(), kMinRange), std::atan2(q.y(), q.x())};
}

Eigen::Matrix2d CovRangeBearing(const Eigen::Vector2d& q, const Eigen::Matrix2d& cov_q) {
  const double range = std::max(q.norm(), kMinRange);
  const Eigen::Vector2d direction = q / range;
  Eigen::Matrix2d dz_dq;
  dz_dq << direction.x(), direction.y(), -direction.y() / range, direction.x() / range;
  return dz_dq * cov_q * dz_dq.transpose();
}

}  // namespace

const std::vector<std::string>& FieldOfViewNames() {
  static const std::vector<std::string> names = {"sector", "scan-polygon"};
  return names;
}

FieldOfViewModel FieldOfViewNamed(const std::string& name) {
  const auto& names = FieldOfViewNames();
  const auto found = std::find(names.begin(), names.end(), name);
  SHIFTMAP_CHECK(found != names.end(), "field of view '{}'", name);
  return static_cast<FieldOfViewModel>(found - names.begin());
}

void LidarView::Take(const LidarScan& newer) {
  scan = newer;
  T_scan_now = Se2();
}

void LidarView::Move(const Se2& T_begin_end, double elapsed_s, Stamp now, double max_age_s) {
  if (scan.ranges_m.empty()) return;
  const double age_s = ToSeconds(now - scan.stamp);
  counts = age_s >= 0.0 && age_s <= max_age_s;
  if (!counts || !(elapsed_s > 0.0)) return;
  const double share = std::min(age_s / elapsed_s, 1.0);
  T_scan_now = T_scan_now * Se2::Exp(share * T_begin_end.Log());
}

void FieldOfView::Look(const LidarView* lidar) {
  by_lidar_ = lidar != nullptr && lidar->counts;
  if (!by_lidar_) return;
  if (polygon_stamp_ != lidar->scan.stamp) polygon_.Assign(lidar->scan, kGrownM);
  polygon_stamp_ = lidar->scan.stamp;
  polygon_.SetVehicle(lidar->T_scan_now);
}

void FieldOfView::Saw(const Eigen::Vector2d& q) {
  if (!learns_) return;
  seen_.Add(q);
  own_ = seen_.MakeSector();
}

InViewProbability FieldOfView::Probability(const Eigen::Vector2d& q,
                                           const Eigen::Matrix2d& cov_q) const {
  const Eigen::Vector2d z = RangeBearing(q);
  const Eigen::Matrix2d cov = CovRangeBearing(q, cov_q);
  InViewProbability in_view;
  in_view.sensor = SectorFieldOfView(z, cov, sensor_);
  if (!(in_view.sensor > 0.0)) return in_view;
  in_view.own = std::min(in_view.sensor, SectorFieldOfView(z, cov, own_));
  if (by_lidar_) {
    const double share = share_(polygon_, q, cov_q);
    in_view.sensor *= share;
    in_view.own *= share;
  }
  return in_view;
}

bool FieldOfView::WellInView(const Eigen::Vector2d& q) const {
  if (!shiftmap::WellInView(q, sensor_) || !shiftmap::WellInView(q, own_)) return false;
  // Half of what the area is grown by: what stands on a wall is in view of it.
  const double clear_m = 0.5 * kGrownM;
  return !by_lidar_ || polygon_.ContainsDisc(q, clear_m).value_or(false);
}

}  // namespace shiftmap
