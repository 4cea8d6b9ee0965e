// SPDX-License-Identifier: Apache-2.0
//
// The values of a run log, to and from generated types. Inside codec/ only.
#pragma once

#include "mapstore/run/run.h"
#include "proto/core/status.h"
#include "proto/run_log.pb.h"

namespace shiftmap {

void ToProto(const OdometrySample& sample, proto::Odometry* out);
void ToProto(const Scan& scan, proto::LandmarkScan* out);
void ToProto(const LidarScan& scan, proto::LidarScan* out);

/// Errors: kInvalidArgument if the message fails ValidateEvent.
StatusOr<OdometrySample> FromProto(const proto::Odometry& in);
StatusOr<Scan> FromProto(const proto::LandmarkScan& in);
StatusOr<LidarScan> FromProto(const proto::LidarScan& in);

}  // namespace shiftmap
