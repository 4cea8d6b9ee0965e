// SPDX-License-Identifier: Apache-2.0
#include "mapstore/server/codec/map_service_codec.h"

#include <google/protobuf/stubs/logging.h>

#include "mapstore/codec/shift_report.h"
#include "mapstore/map/shift_report_check.h"

namespace shiftmap::server {
namespace {

Status CheckHash(const char* field, const std::string& text) {
  if (IsSha256Hex(text)) return OkStatus();
  return InvalidArgument("{}: expected 64 lower-case hex digits", field);
}

void AppendLandmark(const LandmarkGroup& group, proto::GetModeProbabilitiesResponse* out) {
  proto::LandmarkProbabilities* const landmark = out->add_landmark();
  landmark->set_signature(group.signature.text());
  for (int state = 0; state < static_cast<int>(group.probabilities.size()); ++state) {
    proto::ModeProbability* const mode = landmark->add_mode();
    mode->set_mode(group.NumberOf(state).value());
    mode->set_probability(group.probabilities[state]);
  }
}

}  // namespace

void ToProto(const std::vector<AreaSummary>& areas, proto::ListAreasResponse* out) {
  for (const AreaSummary& area : areas) {
    proto::AreaEntry* const entry = out->add_area();
    entry->set_area(area.area);
    entry->set_published_version(area.published.value_or(VersionNumber()).value());
    entry->set_versions(area.versions);
  }
}

void ToProto(const std::vector<VersionSummary>& versions, proto::ListVersionsResponse* out) {
  for (const VersionSummary& version : versions) {
    proto::VersionEntry* const entry = out->add_version();
    entry->set_version(version.version.value());
    entry->set_parent(version.parent.value_or(VersionNumber()).value());
    entry->set_content_hash(version.content_hash);
    entry->set_published(version.published);
    entry->set_created_ns(ToNanoseconds(version.created));
  }
}

void ToProto(const SnapshotInfo& snapshot, proto::Snapshot* out) {
  out->set_area(snapshot.area);
  out->set_version(snapshot.version.value());
  out->set_content_hash(snapshot.content_hash);
  out->set_ledger_sequence(snapshot.ledger_sequence.value());
  out->set_created_ns(ToNanoseconds(snapshot.created));
  out->set_sha256(snapshot.sha256);
  out->set_size_bytes(snapshot.size_bytes);
  for (const SnapshotSignature& each : snapshot.signatures) {
    proto::SnapshotSignature* const signature = out->add_signature();
    signature->set_key_sha256(each.key_sha256);
    signature->set_signature(each.signature);
  }
}

void ToProto(const ReturnResult& result, proto::SubmitReportResponse* out) {
  out->set_duplicate(result.duplicate);
  out->set_evidence_rows(result.evidence_rows);
  for (const SetAsideRows& rows : result.set_aside) {
    proto::SetAsideEntry* const entry = out->add_set_aside();
    entry->set_reason(Describe(rows.reason));
    entry->set_rows(rows.rows);
  }
}

Status ToProto(const MapSnapshot& map,
               const std::vector<std::string>& signatures,
               proto::GetModeProbabilitiesResponse* out) {
  out->set_version(map.version().value());
  out->set_content_hash(map.content_hash());
  out->set_at_ns(ToNanoseconds(map.stamp()));
  if (signatures.empty()) {
    for (const LandmarkGroup& group : map.groups()) AppendLandmark(group, out);
    return OkStatus();
  }
  for (const std::string& signature : signatures) {
    const int index = map.GroupIndex(Signature(signature));
    if (index < 0) return NotFound("area '{}': no landmark '{}'", map.area(), signature);
    AppendLandmark(map.groups()[static_cast<std::size_t>(index)], out);
  }
  return OkStatus();
}

StatusOr<ShiftReport> FromProto(const proto::SubmitReportRequest& in) {
  if (!in.has_report()) return InvalidArgument("report: expected one");
  return DecodeShiftReport(in.report().SerializeAsString());
}

Status CheckRequest(const proto::FetchSnapshotRequest& in) {
  if (!in.sha256().empty()) SHIFTMAP_RETURN_IF_ERROR(CheckHash("sha256", in.sha256()));
  if (!in.have_sha256().empty()) {
    SHIFTMAP_RETURN_IF_ERROR(CheckHash("have_sha256", in.have_sha256()));
  }
  if (in.offset_bytes() < 0 || (in.offset_bytes() > 0 && in.sha256().empty())) {
    return InvalidArgument("offset_bytes {}: expected 0 without sha256, at least 0 with it",
                           in.offset_bytes());
  }
  return OkStatus();
}

StatusOr<UploadRequest> FromProto(const proto::UploadHeader& in) {
  SHIFTMAP_RETURN_IF_ERROR(CheckHash("sha256", in.sha256()));
  if (in.size_bytes() <= 0 || in.offset_bytes() < 0 || in.offset_bytes() > in.size_bytes()) {
    return InvalidArgument("offset_bytes {} of size_bytes {}: expected 0 <= offset <= size > 0",
                           in.offset_bytes(),
                           in.size_bytes());
  }
  return UploadRequest{in.sha256(), in.size_bytes(), in.offset_bytes()};
}

void SilenceProtobuf() { google::protobuf::SetLogHandler(nullptr); }

}  // namespace shiftmap::server
