// SPDX-License-Identifier: Apache-2.0
#include "localizer/models/field_of_view.h"

#include <algorithm>
#include <cmath>

#include "localizer/models/detection_model.h"
#include "proto/core/check.h"

namespace shiftmap {
namespace {

// The bearing of what is nearer is undefined. [m]
constexpr double kMinRange = 1e-3;

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

FieldOfView::FieldOfView(const SensorCalibration& sensor, const FieldOfViewOptions& options)
    : sensor_(sensor), options_(options), share_(options.polygon) {}

void FieldOfView::Take(const LidarScan& scan) {
  if (options_.model != FieldOfViewModel::kScanPolygon) return;
  polygon_.Assign(scan, options_.polygon.grown_m);
  lidar_ = scan.stamp;
}

void FieldOfView::Move(const Se2& T_begin_end, Stamp begin, double elapsed_s) {
  if (!lidar_ || !(elapsed_s > 0.0)) return;
  const double since_s = ToSeconds(begin - *lidar_) + elapsed_s;
  const double share = std::clamp(since_s / elapsed_s, 0.0, 1.0);
  if (share > 0.0) polygon_.MoveVehicle(Se2::Exp(share * T_begin_end.Log()));
}

void FieldOfView::Look(Stamp stamp) {
  by_lidar_ =
      lidar_ && *lidar_ <= stamp && stamp - *lidar_ <= FromSeconds(options_.max_lidar_age_s);
}

double FieldOfView::Probability(const Eigen::Vector2d& q, const Eigen::Matrix2d& cov_q) const {
  const double sector = SectorFieldOfView(RangeBearing(q), CovRangeBearing(q, cov_q), sensor_);
  return by_lidar_ && sector > 0.0 ? sector * share_(polygon_, q, cov_q) : sector;
}

bool FieldOfView::WellInView(const Eigen::Vector2d& q) const {
  if (!shiftmap::WellInView(q, sensor_)) return false;
  // Half of what the area is grown by: what stands on a wall is in view of it.
  const double clear_m = 0.5 * options_.polygon.grown_m;
  return !by_lidar_ || polygon_.ContainsDisc(q, clear_m).value_or(false);
}

}  // namespace shiftmap
