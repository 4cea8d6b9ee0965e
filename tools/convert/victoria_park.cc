// SPDX-License-Identifier: Apache-2.0
#include "tools/convert/victoria_park.h"

#include <cmath>
#include <functional>
#include <numbers>
#include <optional>
#include <utility>

#include "tools/convert/decimal.h"
#include "tools/convert/text_table.h"

namespace shiftmap {
namespace {

// Of the truck. [m]
constexpr double kWheelBase = 2.83;
constexpr double kWheelOffset = 0.76;  // Of the wheel with the encoder from the middle of the axle.

constexpr double kMaxSteeringRad = 1.0;

struct Detection {
  double range_m = 0.0;
  double bearing_raw_rad = 0.0;

  friend bool operator==(const Detection&, const Detection&) = default;
};

Status ForEachCsvRow(const std::string& path,
                     std::size_t columns,
                     const std::function<Status(const TextRow&)>& take) {
  return ForEachRow(path, columns, take, ",");
}

Status TakeStamp(std::string_view text, std::optional<Stamp>* last, Stamp* stamp) {
  SHIFTMAP_ASSIGN_OR_RETURN(*stamp, ParseStamp(text));
  if (*last && *stamp < **last) {
    return InvalidArgument("time {} goes backwards from {:.3f}", text, ToSecondsSinceEpoch(**last));
  }
  *last = *stamp;
  return OkStatus();
}

// The inner wheel of a turn is slower than the middle of the axle, v = v_wheel + ω·offset.
Status ReadControls(const std::string& path, Run* run) {
  std::optional<Stamp> last;
  return ForEachCsvRow(path, 3, [&](const TextRow& row) -> Status {
    OdometrySample sample;
    SHIFTMAP_RETURN_IF_ERROR(TakeStamp(row[0], &last, &sample.stamp));
    SHIFTMAP_ASSIGN_OR_RETURN(const double v_wheel, ParseNumber(row[1]));
    SHIFTMAP_ASSIGN_OR_RETURN(const double steering, ParseNumber(row[2]));
    if (std::abs(steering) > kMaxSteeringRad) {
      return InvalidArgument("steering {} rad, expected within {} rad", steering, kMaxSteeringRad);
    }
    const double curvature = std::tan(steering) / kWheelBase;
    sample.v_mps = v_wheel / (1.0 - kWheelOffset * curvature);
    sample.omega_radps = sample.v_mps * curvature;
    run->odometry.push_back(sample);
    return OkStatus();
  });
}

Observation ToObservation(const Detection& detection, const VictoriaParkOptions& options) {
  const double bearing = detection.bearing_raw_rad - 0.5 * std::numbers::pi;
  Eigen::Matrix2d R;
  R << std::cos(bearing), -std::sin(bearing), std::sin(bearing), std::cos(bearing);
  const Eigen::Vector2d sd(options.sd_range_m, options.sd_bearing_rad * detection.range_m);
  Observation observation;
  observation.kind = Observation::Kind::kCartesian;
  observation.z = kVictoriaParkLaser + R * Eigen::Vector2d(detection.range_m, 0.0);
  const Eigen::Matrix2d cov = R * sd.cwiseAbs2().asDiagonal() * R.transpose();
  observation.cov_z = 0.5 * (cov + cov.transpose());
  return observation;
}

// Collects the rows of one scan after the other and tells new detections from stale ones.
class ScanReader {
 public:
  ScanReader(const VictoriaParkOptions& options, VictoriaParkRun* out)
      : options_(options), out_(out) {}

  Status Take(const TextRow& row) {
    Stamp stamp;
    SHIFTMAP_ASSIGN_OR_RETURN(const std::int64_t scan, ParseInteger(row[0]));
    SHIFTMAP_RETURN_IF_ERROR(TakeStamp(row[1], &last_, &stamp));
    Detection detection;
    SHIFTMAP_ASSIGN_OR_RETURN(detection.range_m, ParseNumber(row[2]));
    SHIFTMAP_ASSIGN_OR_RETURN(detection.bearing_raw_rad, ParseNumber(row[3]));
    if (!(detection.range_m > 0.0)) {
      return InvalidArgument("range {}, expected > 0", detection.range_m);
    }
    if (scan_ != scan) {
      Finish();
      scan_ = scan;
      stamp_ = stamp;
    }
    slots_.push_back(detection);
    ++out_->detection_rows;
    return OkStatus();
  }

  void Finish() {
    if (slots_.empty()) return;
    std::size_t live = slots_.size();
    while (live > 0 && live <= before_.size() && slots_[live - 1] == before_[live - 1]) --live;
    Scan scan{stamp_, {}};
    for (std::size_t i = 0; i < live; ++i) {
      scan.observations.push_back(ToObservation(slots_[i], options_));
    }
    out_->run.scans.push_back(std::move(scan));
    out_->stale_rows += static_cast<std::int64_t>(slots_.size() - live);
    before_ = std::exchange(slots_, {});
  }

 private:
  const VictoriaParkOptions& options_;
  VictoriaParkRun* out_;
  std::optional<std::int64_t> scan_;
  std::optional<Stamp> last_;
  Stamp stamp_;
  std::vector<Detection> slots_;
  std::vector<Detection> before_;  // Of the scan before.
};

}  // namespace

StatusOr<VictoriaParkRun> ReadVictoriaPark(const VictoriaParkOptions& options) {
  if (!(options.sd_range_m > 0.0) || !(options.sd_bearing_rad > 0.0)) {
    return InvalidArgument("sd_range_m {} and sd_bearing_rad {}, expected > 0",
                           options.sd_range_m,
                           options.sd_bearing_rad);
  }
  SHIFTMAP_RETURN_IF_ERROR(CheckFolder("victoria park data set", options.dataset_dir));
  VictoriaParkRun out;
  out.run.info = {"victoria-park", "victoria park"};
  SHIFTMAP_RETURN_IF_ERROR(ReadControls(FileIn(options.dataset_dir, "controls.csv"), &out.run));
  ScanReader scans(options, &out);
  SHIFTMAP_RETURN_IF_ERROR(ForEachCsvRow(FileIn(options.dataset_dir, "tree_detections.csv"),
                                         4,
                                         [&](const TextRow& row) { return scans.Take(row); }));
  scans.Finish();
  SHIFTMAP_RETURN_IF_ERROR(ValidateRun(out.run));
  return out;
}

StatusOr<std::vector<GpsFix>> ReadVictoriaParkGps(const std::string& dataset_dir) {
  SHIFTMAP_RETURN_IF_ERROR(CheckFolder("victoria park data set", dataset_dir));
  std::vector<GpsFix> fixes;
  std::optional<Stamp> last;
  const auto take = [&](const TextRow& row) -> Status {
    GpsFix fix;
    SHIFTMAP_RETURN_IF_ERROR(TakeStamp(row[0], &last, &fix.stamp));
    SHIFTMAP_ASSIGN_OR_RETURN(fix.p_gps_antenna.x(), ParseNumber(row[1]));
    SHIFTMAP_ASSIGN_OR_RETURN(fix.p_gps_antenna.y(), ParseNumber(row[2]));
    fixes.push_back(fix);
    return OkStatus();
  };
  SHIFTMAP_RETURN_IF_ERROR(ForEachCsvRow(FileIn(dataset_dir, "gps.csv"), 3, take));
  return fixes;
}

}  // namespace shiftmap
