// SPDX-License-Identifier: Apache-2.0
//
// Values that several messages share. Inside codec/ only: it names generated types.
#pragma once

#include <cmath>
#include <optional>

#include "localizer/live/messages.h"
#include "mapstore/codec/parse_proto.h"
#include "mapstore/codec/run_log_proto.h"
#include "proto/core/status.h"
#include "proto/live.pb.h"

namespace shiftmap::live {

void ToProto(const PoseWithCovariance& pose, proto::Pose* out);

/// Errors: kInvalidArgument for numbers that are not finite.
StatusOr<PoseWithCovariance> PoseFromProto(const proto::Pose& in);

/// The same of a pose to start from. Errors: kInvalidArgument also where ValidateStart() refuses
/// it.
StatusOr<PoseWithCovariance> StartPoseFromProto(const proto::Pose& in);

proto::LocalizerState StateToProto(LocalizerState state);

/// Errors: kInvalidArgument for a state that there is not.
StatusOr<LocalizerState> StateFromProto(proto::LocalizerState state);

/// Errors: kInvalidArgument for a number that is not finite.
template <typename Proto>
StatusOr<std::optional<double>> OdometerFromProto(const Proto& in) {
  if (!in.has_odometer_m()) return std::optional<double>();
  if (!std::isfinite(in.odometer_m())) {
    return InvalidArgument("odometer_m: {}, expected a finite number", in.odometer_m());
  }
  return std::optional<double>(in.odometer_m());
}

/// Differences of stamps must not overflow, whatever a client sends. Errors: kInvalidArgument
/// before 1970.
Status CheckStamp(Stamp stamp);

/// Decodes an item that the vehicle fed, and checks what a report could not carry.
/// Errors: kInvalidArgument.
StatusOr<OdometrySample> SampleFromProto(const proto::Odometry& in);
StatusOr<Scan> ScanFromProto(const proto::LandmarkScan& in);
StatusOr<LidarScan> LidarScanFromProto(const proto::LidarScan& in);

}  // namespace shiftmap::live
