// SPDX-License-Identifier: Apache-2.0
#include "mapstore/codec/shift_report.h"

#include <uuid/uuid.h>

#include <array>

#include "mapstore/codec/parse_proto.h"
#include "mapstore/core/atomic_file.h"
#include "mapstore/core/input_file.h"
#include "mapstore/map/shift_report_check.h"
#include "proto/mcap/byte_source.h"
#include "proto/shift_report.pb.h"

namespace shiftmap {
namespace {

Status AboutReport(const std::string& path, const Status& status) {
  return Annotate(status, "shift report '{}'", path);
}

void ToProto(const VisitEvidence& visit, proto::VisitEvidence* out) {
  out->set_signature(visit.signature.text());
  out->set_begin_ns(ToNanoseconds(visit.begin));
  out->set_end_ns(ToNanoseconds(visit.end));
  for (const VisitEvidence::ModeLogLikelihood& mode : visit.modes) {
    proto::ModeLogLikelihood* entry = out->add_mode();
    entry->set_mode(mode.mode.value());
    entry->set_log_likelihood(mode.log_likelihood);
  }
  out->set_observation_count(visit.observations);
}

void ToProto(const Decision& decision, proto::Decision* out) {
  out->set_signature(decision.signature.text());
  out->set_mode(decision.mode.value());
  out->set_stamp_ns(ToNanoseconds(decision.stamp));
  out->set_log_odds(decision.log_odds);
}

void ToProto(const UnmappedSighting& sighting, proto::UnmappedSighting* out) {
  out->set_signature(sighting.signature.text());
  out->set_x_m(sighting.p_map_landmark.x());
  out->set_y_m(sighting.p_map_landmark.y());
  out->set_cov_xx_m2(sighting.cov_p_map_landmark(0, 0));
  out->set_cov_xy_m2(sighting.cov_p_map_landmark(0, 1));
  out->set_cov_yy_m2(sighting.cov_p_map_landmark(1, 1));
  out->set_count(sighting.count);
  out->set_first_ns(ToNanoseconds(sighting.first));
  out->set_last_ns(ToNanoseconds(sighting.last));
}

void ToProto(const DroppedCount& dropped, proto::Dropped* out) {
  out->set_reason(dropped.reason);
  out->set_count(dropped.count);
}

VisitEvidence FromProto(const proto::VisitEvidence& in) {
  VisitEvidence visit;
  visit.signature = Signature(in.signature());
  visit.begin = StampFromNanoseconds(in.begin_ns());
  visit.end = StampFromNanoseconds(in.end_ns());
  visit.modes.reserve(static_cast<std::size_t>(in.mode_size()));
  for (const proto::ModeLogLikelihood& mode : in.mode()) {
    visit.modes.push_back({ModeNumber(mode.mode()), mode.log_likelihood()});
  }
  visit.observations = in.observation_count();
  return visit;
}

Decision FromProto(const proto::Decision& in) {
  return {.signature = Signature(in.signature()),
          .mode = ModeNumber(in.mode()),
          .stamp = StampFromNanoseconds(in.stamp_ns()),
          .log_odds = in.log_odds()};
}

UnmappedSighting FromProto(const proto::UnmappedSighting& in) {
  UnmappedSighting sighting;
  sighting.signature = Signature(in.signature());
  sighting.p_map_landmark = {in.x_m(), in.y_m()};
  sighting.cov_p_map_landmark << in.cov_xx_m2(), in.cov_xy_m2(), in.cov_xy_m2(), in.cov_yy_m2();
  sighting.count = in.count();
  sighting.first = StampFromNanoseconds(in.first_ns());
  sighting.last = StampFromNanoseconds(in.last_ns());
  return sighting;
}

ShiftReport FromProto(const proto::ShiftReport& in) {
  ShiftReport report;
  report.uuid = in.uuid();
  report.vehicle = in.vehicle();
  report.area = in.area();
  report.version = VersionNumber(in.version());
  report.content_hash = in.content_hash();
  report.run_hash = in.run_hash();
  report.run_uuid = in.run_uuid();
  report.software = in.software();
  report.begin = StampFromNanoseconds(in.begin_ns());
  report.end = StampFromNanoseconds(in.end_ns());
  for (const auto& visit : in.evidence()) report.evidence.push_back(FromProto(visit));
  for (const auto& decision : in.decision()) report.decisions.push_back(FromProto(decision));
  for (const auto& sighting : in.sighting()) report.sightings.push_back(FromProto(sighting));
  for (const auto& dropped : in.dropped()) {
    report.dropped.push_back({dropped.reason(), dropped.count()});
  }
  return report;
}

std::int64_t ItemsIn(const proto::ShiftReport& report) {
  return std::int64_t{report.evidence_size()} + report.decision_size() + report.sighting_size() +
         report.dropped_size() + (report.run_uuid().empty() ? 0 : 1);
}

Status CheckSize(std::size_t bytes) {
  if (bytes <= kMaxReportBytes) return OkStatus();
  return InvalidArgument("above {} bytes", kMaxReportBytes);
}

StatusOr<ShiftReport> ReadWhole(const std::string& path) {
  SHIFTMAP_ASSIGN_OR_RETURN(std::ifstream file, OpenInputFile(path));
  std::string bytes;
  mcap::ByteSource source(&file);
  SHIFTMAP_RETURN_IF_ERROR(source.Read(kMaxReportBytes + 1, &bytes).status());
  return DecodeShiftReport(bytes);
}

Status WriteChecked(const ShiftReport& report, const std::string& path) {
  // What no reader would accept must not reach a disk: the shift's evidence would be lost later.
  SHIFTMAP_RETURN_IF_ERROR(ValidateShiftReport(report));
  const std::string bytes = EncodeShiftReport(report);
  SHIFTMAP_RETURN_IF_ERROR(CheckSize(bytes.size()));
  SHIFTMAP_ASSIGN_OR_RETURN(AtomicFile file, AtomicFile::Create(path));
  SHIFTMAP_RETURN_IF_ERROR(file.Append(bytes));
  return file.Commit();
}

}  // namespace

std::string EncodeShiftReport(const ShiftReport& report) {
  proto::ShiftReport first;  // Messages that follow each other are one.
  proto::ShiftReport out;
  out.set_uuid(report.uuid);
  out.set_vehicle(report.vehicle);
  out.set_area(report.area);
  out.set_version(report.version.value());
  out.set_content_hash(report.content_hash);
  out.set_run_hash(report.run_hash);
  out.set_run_uuid(report.run_uuid);
  out.set_software(report.software);
  out.set_begin_ns(ToNanoseconds(report.begin));
  out.set_end_ns(ToNanoseconds(report.end));
  for (const VisitEvidence& visit : report.evidence) ToProto(visit, out.add_evidence());
  for (const Decision& decision : report.decisions) ToProto(decision, out.add_decision());
  for (const UnmappedSighting& sighting : report.sightings) ToProto(sighting, out.add_sighting());
  for (const DroppedCount& dropped : report.dropped) ToProto(dropped, out.add_dropped());
  first.set_items(ItemsIn(out));
  return first.SerializeAsString() + out.SerializeAsString();
}

StatusOr<ShiftReport> DecodeShiftReport(const std::string& bytes) {
  SHIFTMAP_RETURN_IF_ERROR(CheckSize(bytes.size()));
  SHIFTMAP_ASSIGN_OR_RETURN(const auto message, ParseProto<proto::ShiftReport>(bytes));
  if (message.items() != 0 && message.items() != ItemsIn(message)) {
    return InvalidArgument("cut off: it has {} of {} items", ItemsIn(message), message.items());
  }
  ShiftReport report = FromProto(message);
  SHIFTMAP_RETURN_IF_ERROR(ValidateShiftReport(report));
  return report;
}

StatusOr<ShiftReport> ReadShiftReport(const std::string& path) {
  auto report = ReadWhole(path);
  if (!report.ok()) return AboutReport(path, report.status());
  return report;
}

Status WriteShiftReport(const ShiftReport& report, const std::string& path) {
  return AboutReport(path, WriteChecked(report, path));
}

std::string RandomUuid() {
  uuid_t uuid;
  uuid_generate_random(uuid);
  std::array<char, UUID_STR_LEN> text{};
  uuid_unparse_lower(uuid, text.data());
  return text.data();
}

}  // namespace shiftmap
