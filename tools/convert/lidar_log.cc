// SPDX-License-Identifier: Apache-2.0
#include "tools/convert/lidar_log.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace shiftmap {
namespace {

// For turning to where no arc leads and back, which takes half of the time between two poses at
// most. [rad/s]
constexpr double kTurnRate = 1.0;
constexpr double kMaxTurnShare = 0.5;

// Below what readers of run logs take for a mistake (mapstore/run/item_limits.h). [m/s], [rad/s]
constexpr double kMaxSpeed = 90.0;
constexpr double kMaxYawRate = 45.0;

constexpr Duration kSampleEvery = std::chrono::seconds(1);
constexpr Duration kMaxMotion = std::chrono::minutes(1);

// Appends samples that hold from `*begin` for `span`, and moves `*begin` on.
void Hold(
    double along, double turn, Duration span, Stamp* begin, std::vector<OdometrySample>* out) {
  const double seconds = ToSeconds(span);
  const Stamp end = *begin + span;
  for (; *begin < end; *begin = std::min(*begin + kSampleEvery, end)) {
    out->push_back({*begin, along / seconds, turn / seconds});
  }
}

// In (-π/2, π/2], driving backwards where that is nearer.
double TurnTo(const Eigen::Vector3d& twist) {
  const double alpha = std::atan2(twist.y(), twist.x());
  if (alpha > 0.5 * std::numbers::pi) return alpha - std::numbers::pi;
  if (alpha <= -0.5 * std::numbers::pi) return alpha + std::numbers::pi;
  return alpha;
}

// Appends samples from where the earlier ones led to, `at`, towards `to`, and moves `at` on.
void AppendWay(const StampedPose& to, StampedPose* at, std::vector<OdometrySample>* out) {
  const Eigen::Vector3d twist = (at->T_map_vehicle.Inverse() * to.T_map_vehicle).Log();
  const Duration span = std::min(to.stamp - at->stamp, kMaxMotion);
  double alpha = TurnTo(twist);
  Duration turn = FromSeconds(std::abs(alpha) / kTurnRate);
  if (2.0 * ToSeconds(turn) > kMaxTurnShare * ToSeconds(span)) {
    alpha = 0.0;
    turn = Duration(0);
  }
  const double seconds = ToSeconds(span - 2 * turn);
  const double along = twist.x() * std::cos(alpha) + twist.y() * std::sin(alpha);
  const double rates =
      std::max(std::abs(along) / kMaxSpeed, std::abs(twist.z()) / kMaxYawRate) / seconds;
  const Eigen::Vector3d drive = Eigen::Vector3d(along, 0.0, twist.z()) / std::max(1.0, rates);
  Stamp begin = at->stamp;
  Hold(0.0, alpha, turn, &begin, out);
  Hold(drive.x(), drive.z(), span - 2 * turn, &begin, out);
  Hold(0.0, -alpha, turn, &begin, out);
  if (begin < to.stamp) out->push_back({begin, 0.0, 0.0});
  const Se2 R(0.0, 0.0, alpha);
  *at = {to.stamp, at->T_map_vehicle * R * Se2::Exp(drive) * R.Inverse()};
}

LidarScan KeptScan(const RangeScan& scan, const LidarSensor& sensor) {
  LidarScan kept{scan.stamp, sensor, {}};
  kept.ranges_m.reserve(scan.ranges_m.size());
  for (const double range_m : scan.ranges_m) {
    kept.ranges_m.push_back(sensor.Returned(range_m) ? static_cast<float>(range_m) : 0.0f);
  }
  return kept;
}

}  // namespace

std::vector<OdometrySample> OdometryFromPoses(std::span<const StampedPose> poses) {
  std::vector<OdometrySample> samples;
  if (poses.empty()) return samples;
  std::optional<StampedPose> at;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    if (i + 1 < poses.size() && poses[i + 1].stamp == poses[i].stamp) continue;
    if (at) {
      AppendWay(poses[i], &*at, &samples);
    } else {
      at = poses[i];
    }
  }
  samples.push_back({at->stamp, 0.0, 0.0});
  return samples;
}

StatusOr<Run> MakeLidarRun(const LidarLog& log,
                           const std::string& vehicle,
                           const LidarFrontEndOptions& options,
                           bool keep_scans) {
  SHIFTMAP_RETURN_IF_ERROR(options.Validate());
  if (log.scans.empty()) return InvalidArgument("file '{}': no scan", log.name);
  Run run{{vehicle, log.name}, OdometryFromPoses(log.poses), {}};
  for (const RangeScan& scan : log.scans) {
    run.scans.push_back(ObserveInterestPoints(scan.stamp, scan.ranges_m, options));
    if (keep_scans) run.lidar_scans.push_back(KeptScan(scan, options.sensor));
  }
  SHIFTMAP_RETURN_IF_ERROR(Annotate(ValidateRun(run), "file '{}'", log.name));
  return run;
}

}  // namespace shiftmap
