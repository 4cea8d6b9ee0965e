// SPDX-License-Identifier: Apache-2.0
#include "mapstore/run/item_limits.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace shiftmap {

ItemLimits ItemLimits::For(const SensorCalibration& sensor) {
  constexpr double kFieldsOfView = 10.0;
  ItemLimits limits;
  limits.max_range_m = std::max(limits.max_range_m, kFieldsOfView * sensor.max_range_m);
  return limits;
}

bool IsPlausible(const OdometrySample& sample, const ItemLimits& limits) {
  return std::abs(sample.v_mps) <= limits.max_speed_mps &&
         std::abs(sample.omega_radps) <= limits.max_yaw_rate_radps;
}

bool IsPlausible(const Observation& observation, const ItemLimits& limits) {
  return observation.kind == Observation::Kind::kRangeBearing
             ? observation.z.x() <= limits.max_range_m
             : observation.z.norm() <= limits.max_range_m;
}

ImplausibleItems DropImplausible(const ItemLimits& limits, Run* run) {
  ImplausibleItems dropped;
  const auto implausible = [&](const auto& item) { return !IsPlausible(item, limits); };
  dropped.odometry = static_cast<std::int64_t>(std::erase_if(run->odometry, implausible));
  for (Scan& scan : run->scans) {
    dropped.observations +=
        static_cast<std::int64_t>(std::erase_if(scan.observations, implausible));
  }
  return dropped;
}

}  // namespace shiftmap
