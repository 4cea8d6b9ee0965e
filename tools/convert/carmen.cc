// SPDX-License-Identifier: Apache-2.0
#include "tools/convert/carmen.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <filesystem>
#include <string_view>
#include <utility>

#include "tools/convert/decimal.h"
#include "tools/convert/text_table.h"

namespace shiftmap {
namespace {

// Of what a log states twice, and of -field_of_view/2 against start_angle. [rad], [m]
constexpr double kSame = 1e-3;

// Takes the fields of a row one after the other.
class Fields {
 public:
  explicit Fields(const TextRow& row) : row_(row) {}

  StatusOr<std::string_view> Text() {
    if (next_ >= row_.size()) {
      return InvalidArgument("{} fields, expected more", row_.size());
    }
    return row_[next_++];
  }
  StatusOr<double> Number() {
    SHIFTMAP_ASSIGN_OR_RETURN(const std::string_view text, Text());
    return ParseNumber(text);
  }
  StatusOr<Se2> Pose() {
    SHIFTMAP_ASSIGN_OR_RETURN(const double x_m, Number());
    SHIFTMAP_ASSIGN_OR_RETURN(const double y_m, Number());
    SHIFTMAP_ASSIGN_OR_RETURN(const double yaw_rad, Number());
    return Se2(x_m, y_m, yaw_rad);
  }
  // A count and as many numbers.
  StatusOr<std::vector<double>> Numbers(std::int64_t min_count) {
    SHIFTMAP_ASSIGN_OR_RETURN(const std::string_view text, Text());
    SHIFTMAP_ASSIGN_OR_RETURN(const std::int64_t count, ParseInteger(text));
    const auto left = static_cast<std::int64_t>(row_.size() - next_);
    if (count < min_count || count > left) {
      return InvalidArgument("{} values announced, expected {}..{}", count, min_count, left);
    }
    std::vector<double> numbers;
    for (std::int64_t i = 0; i < count; ++i) {
      SHIFTMAP_ASSIGN_OR_RETURN(const double number, Number());
      numbers.push_back(number);
    }
    return numbers;
  }
  Status Skip(int numbers) {
    for (int i = 0; i < numbers; ++i) SHIFTMAP_RETURN_IF_ERROR(Number().status());
    return OkStatus();
  }
  // The end of every row: when it was made, by which host, and when it was logged.
  StatusOr<Stamp> Time() {
    SHIFTMAP_ASSIGN_OR_RETURN(const std::string_view time, Text());
    SHIFTMAP_ASSIGN_OR_RETURN(const Stamp stamp, ParseStamp(time));
    SHIFTMAP_RETURN_IF_ERROR(Text().status());
    SHIFTMAP_RETURN_IF_ERROR(Text().status());
    if (next_ != row_.size()) {
      return InvalidArgument("{} fields, expected {}", row_.size(), next_);
    }
    return stamp;
  }

 private:
  const TextRow& row_;
  std::size_t next_ = 1;  // Behind the kind of the row.
};

// Keeps a value that the log states again and again.
Status State(const char* what, double value, std::optional<double>* stated) {
  if (*stated && std::abs(**stated - value) > kSame) {
    return InvalidArgument("{} {}, and {} before", what, value, **stated);
  }
  *stated = value;
  return OkStatus();
}

Status TakeOdometry(const TextRow& row, LidarLog* log) {
  Fields fields(row);
  StampedPose pose;
  SHIFTMAP_ASSIGN_OR_RETURN(pose.T_map_vehicle, fields.Pose());
  SHIFTMAP_RETURN_IF_ERROR(fields.Skip(3));
  SHIFTMAP_ASSIGN_OR_RETURN(pose.stamp, fields.Time());
  log->poses.push_back(pose);
  return OkStatus();
}

void Append(Stamp stamp, const Se2& T_odom_vehicle, std::vector<double> ranges_m, LidarLog* log) {
  log->poses.push_back({stamp, T_odom_vehicle});
  log->scans.push_back({stamp, std::move(ranges_m)});
}

Status TakeFrontLaser(const TextRow& row, LidarLog* log) {
  Fields fields(row);
  SHIFTMAP_ASSIGN_OR_RETURN(std::vector<double> ranges, fields.Numbers(2));
  SHIFTMAP_RETURN_IF_ERROR(fields.Skip(3));
  SHIFTMAP_ASSIGN_OR_RETURN(const Se2 pose, fields.Pose());
  SHIFTMAP_ASSIGN_OR_RETURN(const Stamp stamp, fields.Time());
  Append(stamp, pose, std::move(ranges), log);
  return OkStatus();
}

Status TakeRobotLaser(const TextRow& row, LidarLog* log) {
  Fields fields(row);
  SHIFTMAP_RETURN_IF_ERROR(fields.Skip(1));
  SHIFTMAP_ASSIGN_OR_RETURN(const double start, fields.Number());
  SHIFTMAP_ASSIGN_OR_RETURN(const double view, fields.Number());
  if (std::abs(start + 0.5 * view) > kSame) {
    return InvalidArgument(
        "start angle {} of a field of view of {}, expected half of it to each side", start, view);
  }
  SHIFTMAP_RETURN_IF_ERROR(State("field of view", view, &log->field_of_view_rad));
  SHIFTMAP_RETURN_IF_ERROR(fields.Skip(1));
  SHIFTMAP_ASSIGN_OR_RETURN(const double max_range, fields.Number());
  SHIFTMAP_RETURN_IF_ERROR(State("maximum range", max_range, &log->max_range_m));
  SHIFTMAP_RETURN_IF_ERROR(fields.Skip(2));
  SHIFTMAP_ASSIGN_OR_RETURN(std::vector<double> ranges, fields.Numbers(2));
  SHIFTMAP_RETURN_IF_ERROR(fields.Numbers(0).status());
  SHIFTMAP_RETURN_IF_ERROR(fields.Skip(3));
  SHIFTMAP_ASSIGN_OR_RETURN(const Se2 pose, fields.Pose());
  SHIFTMAP_RETURN_IF_ERROR(fields.Skip(5));
  SHIFTMAP_ASSIGN_OR_RETURN(const Stamp stamp, fields.Time());
  Append(stamp, pose, std::move(ranges), log);
  return OkStatus();
}

}  // namespace

StatusOr<LidarLog> ReadCarmen(const std::string& path) {
  LidarLog log;
  log.name = std::filesystem::path(path).filename().string();
  std::string scan_kind;
  SHIFTMAP_RETURN_IF_ERROR(ForEachRow(path, kAnyColumns, [&](const TextRow& row) -> Status {
    const std::string_view kind = row.front();
    if (kind == "ODOM") return TakeOdometry(row, &log);
    const bool is_scan = kind == "FLASER" || kind == "ROBOTLASER1";
    if (is_scan && scan_kind.empty()) scan_kind = kind;
    if (!is_scan || kind != scan_kind) {
      ++log.skipped_rows;
      return OkStatus();
    }
    return kind == "FLASER" ? TakeFrontLaser(row, &log) : TakeRobotLaser(row, &log);
  }));
  std::stable_sort(log.poses.begin(), log.poses.end(), [](const auto& a, const auto& b) {
    return a.stamp < b.stamp;
  });
  std::stable_sort(log.scans.begin(), log.scans.end(), [](const auto& a, const auto& b) {
    return a.stamp < b.stamp;
  });
  return log;
}

}  // namespace shiftmap
