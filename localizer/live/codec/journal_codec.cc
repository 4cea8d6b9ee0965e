// SPDX-License-Identifier: Apache-2.0
#include "localizer/live/codec/journal_codec.h"

#include "localizer/live/codec/proto_values.h"

namespace shiftmap::live {
namespace {

void Fill(const ShiftHeader& header, proto::JournalRecord* record) {
  proto::ShiftHeader* out = record->mutable_header();
  out->set_uuid(header.uuid);
  out->set_vehicle(header.vehicle);
  out->set_area(header.area);
  out->set_version(header.version.value());
  out->set_content_hash(header.content_hash);
  out->set_map_stamp_ns(ToNanoseconds(header.map_stamp));
  out->set_alpha(header.alpha);
  out->set_max_leaves(header.max_leaves);
  out->set_max_delay_s(header.max_delay_s);
  if (header.odometer_m) out->set_odometer_m(*header.odometer_m);
  const LimitOptions& limits = header.limits;
  if (limits.max_range_m) out->set_max_range_m(*limits.max_range_m);
  if (limits.max_speed_mps) out->set_max_speed_mps(*limits.max_speed_mps);
  out->set_field_of_view(static_cast<proto::FieldOfView>(header.field_of_view));
  out->set_map_sha256(header.map_sha256);
  if (limits.max_yaw_rate_radps) out->set_max_yaw_rate_radps(*limits.max_yaw_rate_radps);
}

void Fill(const OdometrySample& sample, proto::JournalRecord* record) {
  ToProto(sample, record->mutable_odometry());
}

void Fill(const Scan& scan, proto::JournalRecord* record) { ToProto(scan, record->mutable_scan()); }

void Fill(const LidarScan& scan, proto::JournalRecord* record) {
  ToProto(scan, record->mutable_lidar_scan());
}

void Fill(const InitializePose& start, proto::JournalRecord* record) {
  ToProto(start.pose, record->mutable_initialize_pose()->mutable_pose());
}

StatusOr<JournalRecord> HeaderFromProto(const proto::ShiftHeader& in) {
  ShiftHeader header;
  header.uuid = in.uuid();
  header.vehicle = in.vehicle();
  header.area = in.area();
  header.version = VersionNumber(in.version());
  header.content_hash = in.content_hash();
  header.map_stamp = StampFromNanoseconds(in.map_stamp_ns());
  SHIFTMAP_RETURN_IF_ERROR(CheckStamp(header.map_stamp));
  header.alpha = in.alpha();
  header.max_leaves = in.max_leaves();
  header.max_delay_s = in.max_delay_s();
  SHIFTMAP_ASSIGN_OR_RETURN(header.odometer_m, OdometerFromProto(in));
  LimitOptions& limits = header.limits;
  if (in.has_max_range_m()) limits.max_range_m = in.max_range_m();
  if (in.has_max_speed_mps()) limits.max_speed_mps = in.max_speed_mps();
  if (in.has_max_yaw_rate_radps()) limits.max_yaw_rate_radps = in.max_yaw_rate_radps();
  if (in.field_of_view() != proto::SECTOR && in.field_of_view() != proto::SCAN_POLYGON) {
    return InvalidArgument("field_of_view: {}, expected 0 or 1",
                           static_cast<int>(in.field_of_view()));
  }
  header.field_of_view = static_cast<FieldOfViewModel>(in.field_of_view());
  header.map_sha256 = in.map_sha256();
  return JournalRecord(std::move(header));
}

}  // namespace

std::string EncodeJournalRecord(const JournalRecord& record) {
  proto::JournalRecord message;
  std::visit([&](const auto& item) { Fill(item, &message); }, record);
  return message.SerializeAsString();
}

StatusOr<JournalRecord> DecodeJournalRecord(std::string_view bytes) {
  SHIFTMAP_ASSIGN_OR_RETURN(const auto message, ParseProto<proto::JournalRecord>(bytes));
  switch (message.record_case()) {
    case proto::JournalRecord::kHeader:
      return HeaderFromProto(message.header());
    case proto::JournalRecord::kOdometry: {
      SHIFTMAP_ASSIGN_OR_RETURN(const OdometrySample sample, SampleFromProto(message.odometry()));
      return JournalRecord(sample);
    }
    case proto::JournalRecord::kScan: {
      SHIFTMAP_ASSIGN_OR_RETURN(Scan scan, ScanFromProto(message.scan()));
      return JournalRecord(std::move(scan));
    }
    case proto::JournalRecord::kLidarScan: {
      SHIFTMAP_ASSIGN_OR_RETURN(LidarScan scan, LidarScanFromProto(message.lidar_scan()));
      return JournalRecord(std::move(scan));
    }
    case proto::JournalRecord::kInitializePose: {
      SHIFTMAP_ASSIGN_OR_RETURN(const PoseWithCovariance pose,
                                PoseFromProto(message.initialize_pose().pose()));
      return JournalRecord(InitializePose{pose});
    }
    case proto::JournalRecord::RECORD_NOT_SET:
      break;
  }
  return InvalidArgument("record of an unknown kind");
}

std::string EncodeSavedPose(const SavedPose& saved) {
  proto::SavedPose message;
  message.set_area(saved.area);
  message.set_content_hash(saved.content_hash);
  message.set_stamp_ns(ToNanoseconds(saved.stamp));
  ToProto(saved.pose, message.mutable_pose());
  if (saved.odometer_m) message.set_odometer_m(*saved.odometer_m);
  return message.SerializeAsString();
}

StatusOr<SavedPose> DecodeSavedPose(std::string_view bytes) {
  SHIFTMAP_ASSIGN_OR_RETURN(const auto message, ParseProto<proto::SavedPose>(bytes));
  SavedPose saved;
  saved.area = message.area();
  saved.content_hash = message.content_hash();
  saved.stamp = StampFromNanoseconds(message.stamp_ns());
  SHIFTMAP_ASSIGN_OR_RETURN(saved.pose, StartPoseFromProto(message.pose()));
  SHIFTMAP_ASSIGN_OR_RETURN(saved.odometer_m, OdometerFromProto(message));
  return saved;
}

}  // namespace shiftmap::live
