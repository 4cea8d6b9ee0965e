// SPDX-License-Identifier: Apache-2.0
#include "tools/convert/lidar_log.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace shiftmap {
namespace {

// Of the time between two poses, for turning to and for turning back.
constexpr double kTurnShare = 0.1;

// Below this it is rounding. [rad]
constexpr double kMinTurn = 1e-9;

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

void AppendWay(const StampedPose& from, const StampedPose& to, std::vector<OdometrySample>* out) {
  const Eigen::Vector3d twist = (from.T_map_vehicle.Inverse() * to.T_map_vehicle).Log();
  const double alpha = TurnTo(twist);
  const double along = twist.x() * std::cos(alpha) + twist.y() * std::sin(alpha);
  const Duration span = std::min(to.stamp - from.stamp, kMaxMotion);
  const Duration turn =
      std::abs(alpha) > kMinTurn ? FromSeconds(kTurnShare * ToSeconds(span)) : Duration(0);
  Stamp begin = from.stamp;
  if (turn > Duration(0)) Hold(0.0, alpha, turn, &begin, out);
  Hold(along, twist.z(), span - 2 * turn, &begin, out);
  if (turn > Duration(0)) Hold(0.0, -alpha, turn, &begin, out);
  if (begin < to.stamp) out->push_back({begin, 0.0, 0.0});
}

}  // namespace

std::vector<OdometrySample> OdometryFromPoses(std::span<const StampedPose> poses) {
  std::vector<OdometrySample> samples;
  if (poses.empty()) return samples;
  const StampedPose* last = nullptr;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    if (i + 1 < poses.size() && poses[i + 1].stamp == poses[i].stamp) continue;
    if (last != nullptr) AppendWay(*last, poses[i], &samples);
    last = &poses[i];
  }
  samples.push_back({last->stamp, 0.0, 0.0});
  return samples;
}

StatusOr<Run> MakeLidarRun(const LidarLog& log,
                           const std::string& vehicle,
                           const LidarFrontEndOptions& options) {
  SHIFTMAP_RETURN_IF_ERROR(options.Validate());
  if (log.scans.empty()) return InvalidArgument("file '{}': no scan", log.name);
  Run run{{vehicle, log.name}, OdometryFromPoses(log.poses), {}};
  for (const RangeScan& scan : log.scans) {
    run.scans.push_back(ObserveInterestPoints(scan.stamp, scan.ranges_m, options));
  }
  if (const Status status = ValidateRun(run); !status.ok()) {
    return MakeStatus(status.code(), "file '{}': {}", log.name, Message(status));
  }
  return run;
}

}  // namespace shiftmap
