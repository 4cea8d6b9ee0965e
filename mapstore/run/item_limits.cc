// SPDX-License-Identifier: Apache-2.0
#include "mapstore/run/item_limits.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "mapstore/core/magnitude.h"

namespace shiftmap {
namespace {

bool IsPlausible(const Eigen::Matrix2d& cov_z, Observation::Kind kind, double max_range_m) {
  constexpr double kMinSd = 1e-6;
  const double max_second =
      kind == Observation::Kind::kRangeBearing ? std::numbers::pi : max_range_m;
  // At most the smallest eigenvalue.
  const double least = cov_z.determinant() / cov_z.trace();
  return cov_z(0, 0) <= max_range_m * max_range_m && cov_z(1, 1) <= max_second * max_second &&
         least >= kMinSd * kMinSd;
}

Status CheckLimit(const char* name, const std::optional<double>& limit) {
  if (!limit || (*limit > 0.0 && *limit <= kMaxMagnitude)) return OkStatus();
  return InvalidArgument("option {}: {}, expected in (0, {}]", name, *limit, kMaxMagnitude);
}

}  // namespace

ItemLimits ItemLimits::For(const SensorCalibration& sensor) {
  constexpr double kFieldsOfView = 10.0;
  ItemLimits limits;
  limits.max_range_m = std::max(limits.max_range_m, kFieldsOfView * sensor.max_range_m);
  return limits;
}

ItemLimits LimitOptions::For(const SensorCalibration& sensor) const {
  ItemLimits limits = ItemLimits::For(sensor);
  limits.max_range_m = max_range_m.value_or(limits.max_range_m);
  limits.max_speed_mps = max_speed_mps.value_or(limits.max_speed_mps);
  limits.max_yaw_rate_radps = max_yaw_rate_radps.value_or(limits.max_yaw_rate_radps);
  return limits;
}

Status LimitOptions::Validate() const {
  SHIFTMAP_RETURN_IF_ERROR(CheckLimit("max_range_m", max_range_m));
  SHIFTMAP_RETURN_IF_ERROR(CheckLimit("max_speed_mps", max_speed_mps));
  return CheckLimit("max_yaw_rate_radps", max_yaw_rate_radps);
}

bool IsPlausible(const OdometrySample& sample, const ItemLimits& limits) {
  return std::abs(sample.v_mps) <= limits.max_speed_mps &&
         std::abs(sample.omega_radps) <= limits.max_yaw_rate_radps;
}

bool IsPlausible(const Observation& observation, const ItemLimits& limits) {
  const double range_m = observation.kind == Observation::Kind::kRangeBearing
                             ? observation.z.x()
                             : observation.z.norm();
  if (!(range_m <= limits.max_range_m)) return false;
  return !observation.cov_z ||
         IsPlausible(*observation.cov_z, observation.kind, limits.max_range_m);
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
