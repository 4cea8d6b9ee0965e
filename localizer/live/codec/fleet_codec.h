// SPDX-License-Identifier: Apache-2.0
//
// Actions and the fleet's state as Protobuf. Inside codec/ only: it names generated types.
#pragma once

#include "localizer/live/messages.h"
#include "proto/core/status.h"
#include "proto/live.pb.h"

namespace shiftmap::live {

void ToProto(const DownloadMap& action, proto::DownloadMap* out);
void ToProto(const EnableMap& action, proto::EnableMap* out);
void ToProto(const DeleteMap& action, proto::DeleteMap* out);
void ToProto(const InitializePosition& action, proto::InitializePosition* out);
void ToProto(const MapDownloadProgress& progress, proto::MapDownloadProgress* out);
void ToProto(const FleetState& state, proto::FleetState* out);

/// Errors: kInvalidArgument for a name or link that is too long, or a pose as StartPoseFromProto.
StatusOr<DownloadMap> FromProto(const proto::DownloadMap& in);
StatusOr<EnableMap> FromProto(const proto::EnableMap& in);
StatusOr<DeleteMap> FromProto(const proto::DeleteMap& in);
StatusOr<InitializePosition> FromProto(const proto::InitializePosition& in);
StatusOr<MapDownloadProgress> FromProto(const proto::MapDownloadProgress& in);
StatusOr<FleetState> FleetStateFromProto(const proto::FleetState& in);

}  // namespace shiftmap::live
