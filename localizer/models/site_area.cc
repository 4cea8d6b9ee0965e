// SPDX-License-Identifier: Apache-2.0
#include "localizer/models/site_area.h"

#include <Eigen/Geometry>
#include <algorithm>

namespace shiftmap {
namespace {

constexpr double kOnSite = 0.5;  // Probability that a landmark that moved is still on the site.

}  // namespace

double SiteArea(const MapSnapshot& snapshot) {
  Eigen::AlignedBox2d box;
  for (const LandmarkGroup& group : snapshot.groups()) {
    for (const Mode& mode : group.modes) box.extend(mode.p_map_landmark);
  }
  const SensorCalibration& sensor = snapshot.calibration().sensor;
  const double seen = sensor.max_bearing_rad * sensor.max_range_m * sensor.max_range_m;
  return box.isEmpty() ? seen : std::max(seen, box.volume());
}

double UnknownPlaceDensity(const MapSnapshot& snapshot) {
  const SensorCalibration& sensor = snapshot.calibration().sensor;
  return std::max(sensor.new_landmark_density_per_m2,
                  kOnSite * sensor.detection_probability / SiteArea(snapshot));
}

}  // namespace shiftmap
