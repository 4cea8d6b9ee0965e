// SPDX-License-Identifier: Apache-2.0
#include "localizer/live/codec/fleet_codec.h"
#include "localizer/live/codec/live_codec.h"
#include "localizer/live/codec/proto_values.h"
#include "mapstore/map/shift_report_check.h"

namespace shiftmap::live {
namespace {

void Fill(const OdometrySample& sample, proto::Request* out) {
  ToProto(sample, out->mutable_odometry());
}

void Fill(const Scan& scan, proto::Request* out) { ToProto(scan, out->mutable_scan()); }

void Fill(const LidarScan& scan, proto::Request* out) { ToProto(scan, out->mutable_lidar_scan()); }

void Fill(const GetState& get, proto::Request* out) {
  out->mutable_get_state()->set_hypotheses(get.hypotheses);
}

void Fill(const Start& start, proto::Request* out) {
  out->mutable_start()->set_vehicle(start.vehicle);
  if (start.odometer_m) out->mutable_start()->set_odometer_m(*start.odometer_m);
}

void Fill(const Stop& stop, proto::Request* out) {
  out->mutable_stop()->set_save_pose(stop.save_pose);
}

void Fill(const SetMap& map, proto::Request* out) {
  out->mutable_set_map()->set_area(map.area);
  out->mutable_set_map()->set_version(map.version ? map.version->value() : 0);
  out->mutable_set_map()->set_content_hash(map.content_hash);
}

void Fill(const InitializePose& start, proto::Request* out) {
  ToProto(start.pose, out->mutable_initialize_pose()->mutable_pose());
}

void Fill(const Subscribe& subscribe, proto::Request* out) {
  out->mutable_subscribe()->set_poses(subscribe.poses);
  out->mutable_subscribe()->set_states(subscribe.states);
  out->mutable_subscribe()->set_decisions(subscribe.decisions);
  out->mutable_subscribe()->set_map_downloads(subscribe.map_downloads);
  out->mutable_subscribe()->set_map_owner(subscribe.map_owner);
}

void Fill(const DownloadMap& action, proto::Request* out) {
  ToProto(action, out->mutable_download_map());
}

void Fill(const EnableMap& action, proto::Request* out) {
  ToProto(action, out->mutable_enable_map());
}

void Fill(const DeleteMap& action, proto::Request* out) {
  ToProto(action, out->mutable_delete_map());
}

void Fill(const InitializePosition& action, proto::Request* out) {
  ToProto(action, out->mutable_initialize_position());
}

void Fill(const ClearActions&, proto::Request* out) { out->mutable_clear_actions(); }

void Fill(const GetFleetState&, proto::Request* out) { out->mutable_get_fleet_state(); }

void Fill(const MapDownloadProgress& progress, proto::Request* out) {
  ToProto(progress, out->mutable_map_download_progress());
}

Status CheckText(const char* field, const std::string& text) {
  if (text.size() <= kMaxReportTextBytes) return OkStatus();
  return InvalidArgument(
      "{}: {} bytes, expected at most {}", field, text.size(), kMaxReportTextBytes);
}

StatusOr<Command> StartFromProto(const proto::Start& in) {
  SHIFTMAP_RETURN_IF_ERROR(CheckText("vehicle", in.vehicle()));
  Start start{.vehicle = in.vehicle(), .odometer_m = std::nullopt};
  SHIFTMAP_ASSIGN_OR_RETURN(start.odometer_m, OdometerFromProto(in));
  return Command(std::move(start));
}

StatusOr<Command> SetMapFromProto(const proto::SetMap& in) {
  SHIFTMAP_RETURN_IF_ERROR(CheckText("area", in.area()));
  SHIFTMAP_RETURN_IF_ERROR(CheckText("content_hash", in.content_hash()));
  if (in.version() < 0) return InvalidArgument("version: {}, expected 0 or more", in.version());
  SetMap map;
  map.area = in.area();
  if (in.version() > 0) map.version = VersionNumber(in.version());
  map.content_hash = in.content_hash();
  return Command(std::move(map));
}

template <typename Proto>
StatusOr<Command> ActionFromProto(const Proto& in) {
  SHIFTMAP_ASSIGN_OR_RETURN(auto action, FromProto(in));
  return Command(std::move(action));
}

StatusOr<Command> CommandFromProto(const proto::Request& in) {
  switch (in.command_case()) {
    case proto::Request::kOdometry: {
      SHIFTMAP_ASSIGN_OR_RETURN(const OdometrySample sample, SampleFromProto(in.odometry()));
      return Command(sample);
    }
    case proto::Request::kScan: {
      SHIFTMAP_ASSIGN_OR_RETURN(Scan scan, ScanFromProto(in.scan()));
      return Command(std::move(scan));
    }
    case proto::Request::kLidarScan: {
      SHIFTMAP_ASSIGN_OR_RETURN(LidarScan scan, LidarScanFromProto(in.lidar_scan()));
      return Command(std::move(scan));
    }
    case proto::Request::kGetState:
      return Command(GetState{in.get_state().hypotheses()});
    case proto::Request::kStart:
      return StartFromProto(in.start());
    case proto::Request::kStop:
      return Command(Stop{in.stop().save_pose()});
    case proto::Request::kSetMap:
      return SetMapFromProto(in.set_map());
    case proto::Request::kInitializePose: {
      SHIFTMAP_ASSIGN_OR_RETURN(const PoseWithCovariance pose,
                                StartPoseFromProto(in.initialize_pose().pose()));
      return Command(InitializePose{pose});
    }
    case proto::Request::kSubscribe:
      return Command(Subscribe{.poses = in.subscribe().poses(),
                               .states = in.subscribe().states(),
                               .decisions = in.subscribe().decisions(),
                               .map_downloads = in.subscribe().map_downloads(),
                               .map_owner = in.subscribe().map_owner()});
    case proto::Request::kDownloadMap:
      return ActionFromProto(in.download_map());
    case proto::Request::kEnableMap:
      return ActionFromProto(in.enable_map());
    case proto::Request::kDeleteMap:
      return ActionFromProto(in.delete_map());
    case proto::Request::kInitializePosition:
      return ActionFromProto(in.initialize_position());
    case proto::Request::kClearActions:
      return Command(ClearActions());
    case proto::Request::kGetFleetState:
      return Command(GetFleetState());
    case proto::Request::kMapDownloadProgress:
      return ActionFromProto(in.map_download_progress());
    case proto::Request::COMMAND_NOT_SET:
      break;
  }
  return InvalidArgument("request without a command that this build knows");
}

}  // namespace

std::string EncodeRequest(const Request& request) {
  proto::Request message;
  message.set_id(request.id);
  std::visit([&](const auto& command) { Fill(command, &message); }, request.command);
  return message.SerializeAsString();
}

StatusOr<Request> DecodeRequest(std::string_view bytes, std::uint64_t* id) {
  const google::protobuf::LogSilencer silencer;
  proto::Request message;
  const Status parsed = ParseProto(bytes, &message);
  *id = message.id();  // It comes first and is known where the rest is not.
  SHIFTMAP_RETURN_IF_ERROR(parsed);
  SHIFTMAP_ASSIGN_OR_RETURN(Command command, CommandFromProto(message));
  return Request{message.id(), std::move(command)};
}

}  // namespace shiftmap::live
