// SPDX-License-Identifier: Apache-2.0
//
// The messages of proto/map_server.proto, from and to values.
#pragma once

#include <string>
#include <vector>

#include "mapstore/map/evidence.h"
#include "mapstore/map/map_snapshot.h"
#include "mapstore/map/snapshot_info.h"
#include "mapstore/store_types.h"
#include "proto/core/status.h"
#include "proto/map_server.pb.h"

namespace shiftmap::server {

void ToProto(const std::vector<AreaSummary>& areas, proto::ListAreasResponse* out);
void ToProto(const std::vector<VersionSummary>& versions, proto::ListVersionsResponse* out);
void ToProto(const SnapshotInfo& snapshot, proto::Snapshot* out);
void ToProto(const ReturnResult& result, proto::SubmitReportResponse* out);

/// The probabilities of a map's landmarks.
/// @param signatures  Of which landmarks, by a former name too; empty: of all.
/// Errors: kNotFound if the map does not have one.
Status ToProto(const MapSnapshot& map,
               const std::vector<std::string>& signatures,
               proto::GetModeProbabilitiesResponse* out);

/// Errors: as DecodeShiftReport.
StatusOr<ShiftReport> FromProto(const proto::SubmitReportRequest& in);

/// Checks what names a snapshot file and a place in it.
/// Errors: kInvalidArgument.
Status CheckRequest(const proto::FetchSnapshotRequest& in);

/// A run log that is to come.
struct UploadRequest {
  std::string sha256;  ///< Of the whole file, in hex.
  std::int64_t size_bytes = 0;
  std::int64_t offset_bytes = 0;
};

/// Errors: kInvalidArgument if the hash is none, or the numbers do not fit each other.
StatusOr<UploadRequest> FromProto(const proto::UploadHeader& in);

/// Keeps Protobuf's own lines, about bytes that are no message, off this process' standard error.
void SilenceProtobuf();

}  // namespace shiftmap::server
