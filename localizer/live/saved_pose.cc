// SPDX-License-Identifier: Apache-2.0
#include "localizer/live/saved_pose.h"

#include <cerrno>
#include <cmath>
#include <cstring>
#include <fstream>
#include <iterator>

#include "localizer/live/codec/journal_codec.h"
#include "mapstore/core/atomic_file.h"
#include "proto/mcap/crc32.h"

namespace shiftmap::live {
namespace {

// The checksum's line, then the message.
std::string Head(std::string_view message) {
  return fmt::format("shiftmap pose {:08x}\n", mcap::Crc32::Of(message));
}

}  // namespace

Status WriteSavedPose(const SavedPose& saved, const std::string& path) {
  const std::string message = EncodeSavedPose(saved);
  return WriteFileAtomically(path, Head(message) + message);
}

StatusOr<SavedPose> ReadSavedPose(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) {
    return NotFound("saved pose '{}': cannot open: {}", path, std::strerror(errno));
  }
  const std::string bytes((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
  const std::size_t head = Head("").size();
  const std::string message = bytes.size() < head ? "" : bytes.substr(head);
  if (bytes.size() < head || bytes.substr(0, head) != Head(message)) {
    return DataLoss("saved pose '{}': checksum mismatch", path);
  }
  auto saved = DecodeSavedPose(message);
  if (!saved.ok()) return DataLoss("saved pose '{}': {}", path, Message(saved.status()));
  return saved;
}

StatusOr<PoseWithCovariance> UsableStart(const SavedPose& saved,
                                         const MapSnapshot& map,
                                         Stamp now,
                                         std::optional<double> odometer_m,
                                         const SavedPoseOptions& options) {
  if (saved.area != map.area() || saved.content_hash != map.content_hash()) {
    return FailedPrecondition("saved pose: on map {} of area '{}', expected {} of '{}'",
                              saved.content_hash,
                              saved.area,
                              map.content_hash(),
                              map.area());
  }
  const double age_s = ToSecondsSinceEpoch(now) - ToSecondsSinceEpoch(saved.stamp);
  if (age_s < 0.0 || age_s > options.max_age_s) {
    return FailedPrecondition(
        "saved pose: {:.1f} s old, expected 0..{:.1f}", age_s, options.max_age_s);
  }
  if (odometer_m && saved.odometer_m &&
      std::abs(*odometer_m - *saved.odometer_m) > options.max_odometer_m) {
    return FailedPrecondition("saved pose: odometer shows {:.2f} m, expected {:.2f} to {:.2f} m",
                              *odometer_m,
                              *saved.odometer_m,
                              options.max_odometer_m);
  }
  PoseWithCovariance start = saved.pose;
  const Eigen::Vector3d sd(options.sd_position_m, options.sd_position_m, options.sd_yaw_rad);
  start.cov_T_map_vehicle.diagonal() += sd.cwiseAbs2();
  return start;
}

}  // namespace shiftmap::live
