// SPDX-License-Identifier: Apache-2.0
#include "localizer/live/codec/proto_values.h"

#include <cmath>

#include "localizer/initialization/start_pose.h"
#include "mapstore/map/shift_report_check.h"

namespace shiftmap::live {
namespace {

constexpr int kCovarianceValues = 6;

}  // namespace

Status CheckStamp(Stamp stamp) {
  if (stamp >= Stamp()) return OkStatus();
  return InvalidArgument("stamp_ns: {}, expected 0 or more", ToNanoseconds(stamp));
}

void ToProto(const PoseWithCovariance& pose, proto::Pose* out) {
  out->set_x_m(pose.T_map_vehicle.x());
  out->set_y_m(pose.T_map_vehicle.y());
  out->set_yaw_rad(pose.T_map_vehicle.yaw());
  for (int row = 0; row < 3; ++row) {
    for (int column = row; column < 3; ++column) {
      out->add_covariance(pose.cov_T_map_vehicle(row, column));
    }
  }
}

StatusOr<PoseWithCovariance> PoseFromProto(const proto::Pose& in) {
  if (in.covariance_size() != kCovarianceValues) {
    return InvalidArgument(
        "pose: covariance of {} values, expected {}", in.covariance_size(), kCovarianceValues);
  }
  PoseWithCovariance pose;
  pose.T_map_vehicle = Se2(in.x_m(), in.y_m(), in.yaw_rad());
  int next = 0;
  for (int row = 0; row < 3; ++row) {
    for (int column = row; column < 3; ++column) {
      pose.cov_T_map_vehicle(row, column) = in.covariance(next);
      pose.cov_T_map_vehicle(column, row) = in.covariance(next);
      ++next;
    }
  }
  if (!pose.T_map_vehicle.translation().allFinite() || !std::isfinite(pose.T_map_vehicle.yaw()) ||
      !pose.cov_T_map_vehicle.allFinite()) {
    return InvalidArgument("pose: expected finite numbers");
  }
  return pose;
}

StatusOr<PoseWithCovariance> StartPoseFromProto(const proto::Pose& in) {
  SHIFTMAP_ASSIGN_OR_RETURN(PoseWithCovariance pose, PoseFromProto(in));
  SHIFTMAP_RETURN_IF_ERROR(ValidateStart(pose));
  return pose;
}

// The states count from 1 on the wire, in the same order.
proto::LocalizerState StateToProto(LocalizerState state) {
  return static_cast<proto::LocalizerState>(static_cast<int>(state) + 1);
}

StatusOr<LocalizerState> StateFromProto(proto::LocalizerState state) {
  const int index = static_cast<int>(state) - 1;
  if (index < 0 || index >= static_cast<int>(kLocalizerStates)) {
    return InvalidArgument("localizer state {}, expected 1..{}", index + 1, kLocalizerStates);
  }
  return static_cast<LocalizerState>(index);
}

StatusOr<OdometrySample> SampleFromProto(const proto::Odometry& in) {
  SHIFTMAP_ASSIGN_OR_RETURN(const OdometrySample sample, shiftmap::FromProto(in));
  SHIFTMAP_RETURN_IF_ERROR(CheckStamp(sample.stamp));
  return sample;
}

StatusOr<Scan> ScanFromProto(const proto::LandmarkScan& in) {
  SHIFTMAP_ASSIGN_OR_RETURN(Scan scan, shiftmap::FromProto(in));
  SHIFTMAP_RETURN_IF_ERROR(CheckStamp(scan.stamp));
  for (const Observation& observation : scan.observations) {
    const std::size_t length = observation.signature.text().size();
    if (length > kMaxReportTextBytes) {
      return InvalidArgument(
          "signature of {} bytes, expected at most {}", length, kMaxReportTextBytes);
    }
  }
  return scan;
}

StatusOr<LidarScan> LidarScanFromProto(const proto::LidarScan& in) {
  SHIFTMAP_ASSIGN_OR_RETURN(LidarScan scan, shiftmap::FromProto(in));
  SHIFTMAP_RETURN_IF_ERROR(CheckStamp(scan.stamp));
  return scan;
}

}  // namespace shiftmap::live
