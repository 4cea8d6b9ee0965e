// SPDX-License-Identifier: Apache-2.0
#include "mapstore/run/trajectory.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <string_view>

#include "mapstore/core/atomic_file.h"
#include "mapstore/core/input_file.h"
#include "mapstore/core/stamp_check.h"

namespace shiftmap {
namespace {

constexpr double kPlanarTolerance = 1e-6;
constexpr double kQuaternionTolerance = 1e-3;
// Beyond this, seconds do not fit into a Stamp.
constexpr double kMaxSeconds = 9.2e9;

constexpr std::string_view kBlank = " \t\r";

bool IsComment(std::string_view line) {
  const std::size_t begin = line.find_first_not_of(kBlank);
  return begin == std::string_view::npos || line[begin] == '#';
}

// Reads exactly eight numbers separated by blanks.
std::optional<std::array<double, 8>> ParseFields(std::string_view line) {
  std::array<double, 8> fields{};
  for (double& field : fields) {
    const std::size_t begin = line.find_first_not_of(kBlank);
    if (begin == std::string_view::npos) return std::nullopt;
    line.remove_prefix(begin);
    const std::size_t length = std::min(line.find_first_of(kBlank), line.size());
    const auto [end, error] = std::from_chars(line.data(), line.data() + length, field);
    if (error != std::errc() || end != line.data() + length || !std::isfinite(field)) {
      return std::nullopt;
    }
    line.remove_prefix(length);
  }
  if (line.find_first_not_of(kBlank) != std::string_view::npos) return std::nullopt;
  return fields;
}

// Rounding to microseconds undoes what a double loses on seconds since the epoch.
Stamp StampFromTum(double seconds) {
  return Stamp(std::chrono::microseconds(std::llround(seconds * 1e6)));
}

StatusOr<StampedPose> ParsePose(std::string_view line) {
  const std::optional<std::array<double, 8>> fields = ParseFields(line);
  if (!fields) return InvalidArgument("expected eight numbers 't x y z qx qy qz qw'");
  const auto& [t, x, y, z, qx, qy, qz, qw] = *fields;
  if (std::abs(t) > kMaxSeconds) {
    return InvalidArgument("stamp {} s, expected seconds since the epoch", t);
  }
  if (std::max({std::abs(z), std::abs(qx), std::abs(qy)}) > kPlanarTolerance) {
    return InvalidArgument("pose is not in the plane: z = {}, qx = {}, qy = {}", z, qx, qy);
  }
  const double norm = std::hypot(qz, qw);
  if (std::abs(norm - 1.0) > kQuaternionTolerance) {
    return InvalidArgument("quaternion of norm {}, expected 1", norm);
  }
  const StampedPose pose{StampFromTum(t), Se2(x, y, 2.0 * std::atan2(qz, qw))};
  SHIFTMAP_RETURN_IF_ERROR(ValidateStamp(pose.stamp));
  return pose;
}

Status WriteLines(std::span<const StampedPose> trajectory, const std::string& path) {
  SHIFTMAP_ASSIGN_OR_RETURN(AtomicFile file, AtomicFile::Create(path));
  for (const StampedPose& pose : trajectory) {
    const auto stamp_us = std::chrono::round<std::chrono::microseconds>(pose.stamp);
    const std::int64_t us = stamp_us.time_since_epoch().count();
    const double half_yaw = 0.5 * pose.T_map_vehicle.yaw();
    SHIFTMAP_RETURN_IF_ERROR(file.Append(fmt::format("{}{}.{:06} {} {} 0 0 0 {} {}\n",
                                                     us < 0 ? "-" : "",
                                                     std::abs(us) / 1'000'000,
                                                     std::abs(us) % 1'000'000,
                                                     pose.T_map_vehicle.x(),
                                                     pose.T_map_vehicle.y(),
                                                     std::sin(half_yaw),
                                                     std::cos(half_yaw))));
  }
  return file.Commit();
}

}  // namespace

StatusOr<std::vector<StampedPose>> ReadTum(const std::string& path) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::string text, ReadInputFile("trajectory", path));
  std::vector<StampedPose> trajectory;
  std::string_view rest = text;
  std::string_view line;
  for (int number = 1; TakeLine(&rest, &line); ++number) {
    if (IsComment(line)) continue;
    StatusOr<StampedPose> pose = ParsePose(line);
    if (!pose.ok()) {
      return InvalidArgument("trajectory '{}:{}': {}", path, number, Message(pose.status()));
    }
    if (!trajectory.empty() && pose->stamp < trajectory.back().stamp) {
      return InvalidArgument("trajectory '{}:{}': goes backwards in time", path, number);
    }
    trajectory.push_back(*pose);
  }
  return trajectory;
}

Status WriteTum(std::span<const StampedPose> trajectory, const std::string& path) {
  return Annotate(WriteLines(trajectory, path), "trajectory '{}'", path);
}

std::optional<Se2> Interpolate(std::span<const StampedPose> trajectory,
                               Stamp stamp,
                               Duration max_gap) {
  const auto after = std::lower_bound(
      trajectory.begin(), trajectory.end(), stamp, [](const StampedPose& pose, Stamp value) {
        return pose.stamp < value;
      });
  if (after == trajectory.end()) return std::nullopt;
  if (after->stamp == stamp) return after->T_map_vehicle;
  if (after == trajectory.begin()) return std::nullopt;
  const StampedPose& before = *std::prev(after);
  const Duration gap = after->stamp - before.stamp;
  if (gap > max_gap) return std::nullopt;
  const double share = ToSeconds(stamp - before.stamp) / ToSeconds(gap);
  const Se2 T_before_after = before.T_map_vehicle.Inverse() * after->T_map_vehicle;
  return before.T_map_vehicle * Se2::Exp(share * T_before_after.Log());
}

StatusOr<Se2> AlignRigid2d(std::span<const PointPair> pairs) {
  if (pairs.size() < 2) {
    return InvalidArgument("alignment: {} pairs of points, expected at least 2", pairs.size());
  }
  Eigen::Vector2d mean_a = Eigen::Vector2d::Zero();
  Eigen::Vector2d mean_b = Eigen::Vector2d::Zero();
  for (const PointPair& pair : pairs) {
    mean_a += pair.p_a;
    mean_b += pair.p_b;
  }
  mean_a /= static_cast<double>(pairs.size());
  mean_b /= static_cast<double>(pairs.size());
  double dot = 0.0;
  double cross = 0.0;
  double spread = 0.0;
  for (const PointPair& pair : pairs) {
    const Eigen::Vector2d a = pair.p_a - mean_a;
    const Eigen::Vector2d b = pair.p_b - mean_b;
    dot += b.dot(a);
    cross += b.x() * a.y() - b.y() * a.x();
    spread += a.squaredNorm() * b.squaredNorm();
  }
  if (!(std::hypot(dot, cross) > 1e-12 * std::sqrt(spread)) || spread == 0.0) {
    return InvalidArgument("alignment: points coincide, the rotation is undefined");
  }
  const double yaw = std::atan2(cross, dot);
  return Se2(mean_a - Se2(0.0, 0.0, yaw) * mean_b, yaw);
}

}  // namespace shiftmap
