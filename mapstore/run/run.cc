// SPDX-License-Identifier: Apache-2.0
#include "mapstore/run/run.h"

#include <algorithm>
#include <cmath>
#include <iterator>

#include "mapstore/core/magnitude.h"
#include "mapstore/core/stamp_check.h"
#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

bool IsWithinMagnitude(double value) { return std::abs(value) <= kMaxMagnitude; }

Status ValidateItem(const OdometrySample& sample) {
  SHIFTMAP_RETURN_IF_ERROR(ValidateStamp(sample.stamp));
  if (!IsWithinMagnitude(sample.v_mps) || !IsWithinMagnitude(sample.omega_radps)) {
    return InvalidArgument(
        "odometry at {:.6f} s: v = {} m/s, omega = {} rad/s, expected finite numbers up to {}",
        ToSecondsSinceEpoch(sample.stamp),
        sample.v_mps,
        sample.omega_radps,
        kMaxMagnitude);
  }
  return OkStatus();
}

Status ValidateItem(const Scan& scan) {
  SHIFTMAP_RETURN_IF_ERROR(ValidateStamp(scan.stamp));
  for (const Observation& observation : scan.observations) {
    const bool range_bearing = observation.kind == Observation::Kind::kRangeBearing;
    const bool within =
        IsWithinMagnitude(observation.z.x()) && IsWithinMagnitude(observation.z.y());
    if (!within || (range_bearing && observation.z.x() <= 0.0)) {
      return InvalidArgument(
          "scan at {:.6f} s: landmark '{}': z = ({}, {}), expected finite numbers up to {}{}",
          ToSecondsSinceEpoch(scan.stamp),
          observation.signature.text(),
          observation.z.x(),
          observation.z.y(),
          kMaxMagnitude,
          range_bearing ? " and a positive range" : "");
    }
    if (observation.cov_z && !IsSymmetricPositiveDefinite(*observation.cov_z)) {
      return InvalidArgument("scan at {:.6f} s: landmark '{}': covariance is not positive definite",
                             ToSecondsSinceEpoch(scan.stamp),
                             observation.signature.text());
    }
    if (observation.cov_z && observation.cov_z->maxCoeff() > kMaxVariance) {
      return InvalidArgument("scan at {:.6f} s: landmark '{}': variance {}, expected at most {}",
                             ToSecondsSinceEpoch(scan.stamp),
                             observation.signature.text(),
                             observation.cov_z->maxCoeff(),
                             kMaxVariance);
    }
  }
  return OkStatus();
}

Status ValidateItem(const LidarScan& scan) {
  SHIFTMAP_RETURN_IF_ERROR(ValidateStamp(scan.stamp));
  const auto refused = [&](const std::string& what) {
    return InvalidArgument("lidar scan at {:.6f} s: {}", ToSecondsSinceEpoch(scan.stamp), what);
  };
  const Status sensor = scan.sensor.Validate();
  if (!sensor.ok()) return refused(Message(sensor));
  const std::size_t beams = scan.ranges_m.size();
  if (beams < 2 || beams > LidarScan::kMaxBeams) {
    return refused(fmt::format("{} beams, expected 2 to {}", beams, LidarScan::kMaxBeams));
  }
  for (std::size_t beam = 0; beam < beams; ++beam) {
    const float range_m = scan.ranges_m[beam];
    if (range_m >= 0.0f && range_m <= LidarSensor::kMaxRangeM) continue;
    return refused(fmt::format("beam {}: range {} m, expected 0 (no return) to {}",
                               beam,
                               range_m,
                               LidarSensor::kMaxRangeM));
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

Stamp BeginOf(const Run& run) {
  const Stamp odometry = run.odometry.front().stamp;
  return run.scans.empty() ? odometry : std::min(odometry, run.scans.front().stamp);
}

Stamp EndOf(const Run& run) {
  const Stamp odometry = run.odometry.back().stamp;
  return run.scans.empty() ? odometry : std::max(odometry, run.scans.back().stamp);
}

Status ValidateRun(const Run& run) {
  if (run.odometry.empty()) return InvalidArgument("run has no odometry");
  SHIFTMAP_RETURN_IF_ERROR(ValidateSequence(run.odometry, "odometry"));
  SHIFTMAP_RETURN_IF_ERROR(ValidateSequence(run.scans, "scans"));
  return ValidateSequence(run.lidar_scans, "lidar scans");
}

Status ForEachEvent(const Run& run, const std::function<Status(const RunEvent&)>& take) {
  auto sample = run.odometry.begin();
  auto lidar = run.lidar_scans.begin();
  auto scan = run.scans.begin();
  const auto stamp = [](const auto& items, auto next) {
    return next == items.end() ? Stamp::max() : next->stamp;
  };
  for (;;) {
    const Stamp odometry_stamp = stamp(run.odometry, sample);
    const Stamp lidar_stamp = stamp(run.lidar_scans, lidar);
    const Stamp scan_stamp = stamp(run.scans, scan);
    const Stamp first = std::min({odometry_stamp, lidar_stamp, scan_stamp});
    if (first == Stamp::max()) return OkStatus();
    if (odometry_stamp == first) {
      SHIFTMAP_RETURN_IF_ERROR(take(*sample++));
    } else if (lidar_stamp == first) {
      SHIFTMAP_RETURN_IF_ERROR(take(*lidar++));
    } else {
      SHIFTMAP_RETURN_IF_ERROR(take(*scan++));
    }
  }
}

std::vector<RunEvent> MergeEvents(const Run& run) {
  std::vector<RunEvent> events;
  events.reserve(run.odometry.size() + run.lidar_scans.size() + run.scans.size());
  ForEachEvent(run, [&](const RunEvent& event) {
    events.push_back(event);
    return OkStatus();
  }).IgnoreError();
  return events;
}

}  // namespace shiftmap
