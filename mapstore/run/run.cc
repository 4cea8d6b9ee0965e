// SPDX-License-Identifier: Apache-2.0
#include "mapstore/run/run.h"

#include <cmath>
#include <iterator>
#include <type_traits>

#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

Status ValidateItem(const OdometrySample& sample) {
  if (!std::isfinite(sample.v_mps) || !std::isfinite(sample.omega_radps)) {
    return InvalidArgument(
        "odometry at {:.6f} s: v = {} m/s, omega = {} rad/s, expected finite numbers",
        ToSecondsSinceEpoch(sample.stamp),
        sample.v_mps,
        sample.omega_radps);
  }
  return OkStatus();
}

Status ValidateItem(const Scan& scan) {
  for (const Observation& observation : scan.observations) {
    const bool range_bearing = observation.kind == Observation::Kind::kRangeBearing;
    if (!observation.z.allFinite() || (range_bearing && observation.z.x() <= 0.0)) {
      return InvalidArgument(
          "scan at {:.6f} s: landmark '{}': z = ({}, {}), expected finite numbers{}",
          ToSecondsSinceEpoch(scan.stamp),
          observation.signature.text(),
          observation.z.x(),
          observation.z.y(),
          range_bearing ? " and a positive range" : "");
    }
    if (observation.cov_z && !IsSymmetricPositiveDefinite(*observation.cov_z)) {
      return InvalidArgument("scan at {:.6f} s: landmark '{}': covariance is not positive definite",
                             ToSecondsSinceEpoch(scan.stamp),
                             observation.signature.text());
    }
  }
  return OkStatus();
}

template <typename Item>
Status ValidateSequence(const std::vector<Item>& items, const char* name) {
  for (std::size_t i = 0; i < items.size(); ++i) {
    if (i > 0 && items[i].stamp < items[i - 1].stamp) {
      return InvalidArgument("{} goes backwards in time: {:.6f} s after {:.6f} s",
                             name,
                             ToSecondsSinceEpoch(items[i].stamp),
                             ToSecondsSinceEpoch(items[i - 1].stamp));
    }
    SHIFTMAP_RETURN_IF_ERROR(ValidateItem(items[i]));
  }
  return OkStatus();
}

}  // namespace

Eigen::Vector2d Observation::PositionInVehicle() const {
  if (kind == Kind::kCartesian) return z;
  return {z.x() * std::cos(z.y()), z.x() * std::sin(z.y())};
}

Status ValidateEvent(const RunEvent& event) {
  return std::visit([](const auto& item) { return ValidateItem(item); }, event);
}

Status ValidateRun(const Run& run) {
  if (run.odometry.empty()) return InvalidArgument("run has no odometry");
  SHIFTMAP_RETURN_IF_ERROR(ValidateSequence(run.odometry, "odometry"));
  return ValidateSequence(run.scans, "scans");
}

std::vector<RunEvent> MergeEvents(const Run& run) {
  std::vector<RunEvent> events;
  events.reserve(run.odometry.size() + run.scans.size());
  auto scan = run.scans.begin();
  for (const OdometrySample& sample : run.odometry) {
    for (; scan != run.scans.end() && scan->stamp < sample.stamp; ++scan)
      events.emplace_back(*scan);
    events.emplace_back(sample);
  }
  for (; scan != run.scans.end(); ++scan) events.emplace_back(*scan);
  return events;
}

}  // namespace shiftmap
