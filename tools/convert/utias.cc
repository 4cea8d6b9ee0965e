// SPDX-License-Identifier: Apache-2.0
#include "tools/convert/utias.h"

#include <filesystem>
#include <unordered_map>

#include "tools/convert/decimal.h"
#include "tools/convert/text_table.h"

namespace shiftmap {
namespace {

constexpr std::int64_t kRobots = 5;  // They are subjects 1 to 5.

// A stamp (ParseStamp) plus a start and a duration below this fits its type.
constexpr double kMaxStretchSeconds = 1e9;

using SubjectOfBarcode = std::unordered_map<std::int64_t, std::int64_t>;

/// The stretch [begin, end) of a run.
struct Stretch {
  Stamp begin;
  Stamp end;
  bool Contains(Stamp stamp) const { return begin <= stamp && stamp < end; }
};

std::string RobotFile(const UtiasOptions& options, const char* kind) {
  return FileIn(options.dataset_dir, fmt::format("Robot{}_{}.dat", options.robot, kind));
}

std::string FolderName(const std::string& folder) {
  std::error_code error;
  const std::filesystem::path path = std::filesystem::absolute(folder, error).lexically_normal();
  return (path.has_filename() ? path : path.parent_path()).filename().string();
}

Status CheckOptions(const UtiasOptions& options) {
  if (options.robot < 1 || options.robot > kRobots) {
    return InvalidArgument("utias robot {}, expected 1..{}", options.robot, kRobots);
  }
  const double duration_s = options.duration_s.value_or(1.0);
  if (!(options.start_s >= 0.0 && options.start_s < kMaxStretchSeconds && duration_s > 0.0 &&
        duration_s < kMaxStretchSeconds)) {
    return InvalidArgument("utias stretch of {} s from {} s, expected start >= 0, duration > 0",
                           duration_s,
                           options.start_s);
  }
  return CheckFolder("utias data set", options.dataset_dir);
}

// Parses a stamp that must not be before the last one.
StatusOr<Stamp> NextStamp(std::string_view text, std::optional<Stamp>* last) {
  SHIFTMAP_ASSIGN_OR_RETURN(const Stamp stamp, ParseStamp(text));
  if (*last && stamp < **last) {
    return InvalidArgument("time {} goes backwards from {:.3f}", text, ToSecondsSinceEpoch(**last));
  }
  *last = stamp;
  return stamp;
}

StatusOr<SubjectOfBarcode> ReadBarcodes(const std::string& dataset_dir) {
  SubjectOfBarcode subjects;
  SHIFTMAP_RETURN_IF_ERROR(
      ForEachRow(FileIn(dataset_dir, "Barcodes.dat"), 2, [&](const TextRow& row) -> Status {
        SHIFTMAP_ASSIGN_OR_RETURN(const std::int64_t subject, ParseInteger(row[0]));
        SHIFTMAP_ASSIGN_OR_RETURN(const std::int64_t barcode, ParseInteger(row[1]));
        if (!subjects.emplace(barcode, subject).second) {
          return InvalidArgument("barcode {} is listed twice", barcode);
        }
        return OkStatus();
      }));
  return subjects;
}

StatusOr<Stretch> ReadOdometry(const UtiasOptions& options, UtiasRun* out) {
  Stretch stretch;
  std::optional<Stamp> last;
  const auto take = [&](const TextRow& row) -> Status {
    const bool first = !last;
    OdometrySample sample;
    SHIFTMAP_ASSIGN_OR_RETURN(sample.stamp, NextStamp(row[0], &last));
    SHIFTMAP_ASSIGN_OR_RETURN(sample.v_mps, ParseNumber(row[1]));
    SHIFTMAP_ASSIGN_OR_RETURN(sample.omega_radps, ParseNumber(row[2]));
    if (first) {
      stretch.begin = sample.stamp + FromSeconds(options.start_s);
      stretch.end =
          options.duration_s ? stretch.begin + FromSeconds(*options.duration_s) : Stamp::max();
    }
    if (!stretch.Contains(sample.stamp)) return OkStatus();
    out->run.odometry.push_back(sample);
    ++out->odometry_rows;
    return OkStatus();
  };
  SHIFTMAP_RETURN_IF_ERROR(ForEachRow(RobotFile(options, "Odometry"), 3, take));
  if (out->run.odometry.empty()) {
    return InvalidArgument("file '{}': no odometry {} s after its first row",
                           RobotFile(options, "Odometry"),
                           options.start_s);
  }
  return stretch;
}

Status ReadMeasurements(const UtiasOptions& options,
                        const SubjectOfBarcode& subjects,
                        const Stretch& stretch,
                        UtiasRun* out) {
  std::vector<Scan>& scans = out->run.scans;
  std::optional<Stamp> last;
  const auto take = [&](const TextRow& row) -> Status {
    SHIFTMAP_ASSIGN_OR_RETURN(const Stamp stamp, NextStamp(row[0], &last));
    SHIFTMAP_ASSIGN_OR_RETURN(const std::int64_t barcode, ParseInteger(row[1]));
    SHIFTMAP_ASSIGN_OR_RETURN(const double range_m, ParseNumber(row[2]));
    SHIFTMAP_ASSIGN_OR_RETURN(const double bearing_rad, ParseNumber(row[3]));
    if (range_m <= 0.0) return InvalidArgument("range {} m, expected above 0", range_m);
    if (!stretch.Contains(stamp)) return OkStatus();
    ++out->measurement_rows;
    if (scans.empty() || scans.back().stamp != stamp) {
      scans.push_back({.stamp = stamp, .observations = {}});
    }
    const auto subject = subjects.find(barcode);
    if (subject == subjects.end()) {
      ++out->unlisted_measurements;
    } else if (subject->second <= kRobots) {
      ++out->robot_measurements;
    } else {
      Observation& observation = scans.back().observations.emplace_back();
      observation.signature = Signature(fmt::format("{}", barcode));
      observation.kind = Observation::Kind::kRangeBearing;
      observation.z = {range_m, bearing_rad};
    }
    return OkStatus();
  };
  return ForEachRow(RobotFile(options, "Measurement"), 4, take);
}

}  // namespace

StatusOr<UtiasRun> ReadUtias(const UtiasOptions& options) {
  SHIFTMAP_RETURN_IF_ERROR(CheckOptions(options));
  SHIFTMAP_ASSIGN_OR_RETURN(const SubjectOfBarcode subjects, ReadBarcodes(options.dataset_dir));
  UtiasRun out;
  out.run.info.vehicle = fmt::format("mrclam_robot{}", options.robot);
  out.run.info.source =
      fmt::format("utias {} robot {}", FolderName(options.dataset_dir), options.robot);
  SHIFTMAP_ASSIGN_OR_RETURN(const Stretch stretch, ReadOdometry(options, &out));
  SHIFTMAP_RETURN_IF_ERROR(ReadMeasurements(options, subjects, stretch, &out));
  return out;
}

StatusOr<std::vector<StampedPose>> ReadUtiasGroundtruth(const std::string& dataset_dir, int robot) {
  UtiasOptions options;
  options.dataset_dir = dataset_dir;
  options.robot = robot;
  SHIFTMAP_RETURN_IF_ERROR(CheckOptions(options));
  std::vector<StampedPose> poses;
  std::optional<Stamp> last;
  SHIFTMAP_RETURN_IF_ERROR(
      ForEachRow(RobotFile(options, "Groundtruth"), 4, [&](const TextRow& row) -> Status {
        SHIFTMAP_ASSIGN_OR_RETURN(const Stamp stamp, NextStamp(row[0], &last));
        SHIFTMAP_ASSIGN_OR_RETURN(const double x_m, ParseNumber(row[1]));
        SHIFTMAP_ASSIGN_OR_RETURN(const double y_m, ParseNumber(row[2]));
        SHIFTMAP_ASSIGN_OR_RETURN(const double yaw_rad, ParseNumber(row[3]));
        poses.push_back({stamp, Se2(x_m, y_m, yaw_rad)});
        return OkStatus();
      }));
  return poses;
}

StatusOr<std::map<Signature, Eigen::Vector2d>> ReadUtiasLandmarks(const std::string& dataset_dir) {
  SHIFTMAP_RETURN_IF_ERROR(CheckFolder("utias data set", dataset_dir));
  SHIFTMAP_ASSIGN_OR_RETURN(const SubjectOfBarcode subjects, ReadBarcodes(dataset_dir));
  std::unordered_map<std::int64_t, Signature> signatures;
  for (const auto& [barcode, subject] : subjects) {
    signatures[subject] = Signature(fmt::format("{}", barcode));
  }
  std::map<Signature, Eigen::Vector2d> landmarks;
  const std::string path = FileIn(dataset_dir, "Landmark_Groundtruth.dat");
  SHIFTMAP_RETURN_IF_ERROR(ForEachRow(path, 5, [&](const TextRow& row) -> Status {
    SHIFTMAP_ASSIGN_OR_RETURN(const std::int64_t subject, ParseInteger(row[0]));
    SHIFTMAP_ASSIGN_OR_RETURN(const double x_m, ParseNumber(row[1]));
    SHIFTMAP_ASSIGN_OR_RETURN(const double y_m, ParseNumber(row[2]));
    const auto signature = signatures.find(subject);
    if (signature == signatures.end()) return InvalidArgument("subject {} has no barcode", subject);
    if (!landmarks.emplace(signature->second, Eigen::Vector2d(x_m, y_m)).second) {
      return InvalidArgument("subject {} is listed twice", subject);
    }
    return OkStatus();
  }));
  return landmarks;
}

}  // namespace shiftmap
