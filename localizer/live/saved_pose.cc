// SPDX-License-Identifier: Apache-2.0
#include "localizer/live/saved_pose.h"

#include <cmath>
#include <string_view>

#include "localizer/live/checked_file.h"
#include "localizer/live/codec/journal_codec.h"

namespace shiftmap::live {
namespace {

constexpr std::string_view kKind = "pose";

constexpr double kMaxOdometerM = 0.5;  // The vehicle was moved if its odometer differs by more. [m]
constexpr double kParkedSdM = 0.1;     // What a parked vehicle may be off by. [m]
constexpr double kParkedSdRad = 0.05;  // [rad]

}  // namespace

Status WriteSavedPose(const SavedPose& saved, const std::string& path) {
  return WriteCheckedFile(kKind, EncodeSavedPose(saved), path);
}

StatusOr<SavedPose> ReadSavedPose(const std::string& path) {
  const auto message = ReadCheckedFile(kKind, path);
  SHIFTMAP_RETURN_IF_ERROR(Annotate(message.status(), "saved pose '{}'", path));
  auto saved = DecodeSavedPose(*message);
  if (!saved.ok()) return DataLoss("saved pose '{}': {}", path, Message(saved.status()));
  return saved;
}

StatusOr<PoseWithCovariance> UsableStart(const SavedPose& saved,
                                         const MapSnapshot& map,
                                         Stamp now,
                                         std::optional<double> odometer_m,
                                         double max_age_s) {
  if (saved.area != map.area() || saved.content_hash != map.content_hash()) {
    return FailedPrecondition("saved pose: on map {} of area '{}', expected {} of '{}'",
                              saved.content_hash,
                              saved.area,
                              map.content_hash(),
                              map.area());
  }
  const double age_s = ToSecondsSinceEpoch(now) - ToSecondsSinceEpoch(saved.stamp);
  if (age_s < 0.0 || age_s > max_age_s) {
    return FailedPrecondition("saved pose: {:.1f} s old, expected 0..{:.1f}", age_s, max_age_s);
  }
  if (odometer_m && saved.odometer_m && std::abs(*odometer_m - *saved.odometer_m) > kMaxOdometerM) {
    return FailedPrecondition("saved pose: odometer shows {:.2f} m, expected {:.2f} to {:.2f} m",
                              *odometer_m,
                              *saved.odometer_m,
                              kMaxOdometerM);
  }
  PoseWithCovariance start = saved.pose;
  const Eigen::Vector3d sd(kParkedSdM, kParkedSdM, kParkedSdRad);
  start.cov_T_map_vehicle.diagonal() += sd.cwiseAbs2();
  return start;
}

}  // namespace shiftmap::live
