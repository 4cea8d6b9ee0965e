// SPDX-License-Identifier: Apache-2.0
#include "localizer/live/codec/fleet_codec.h"

#include "localizer/live/codec/journal_codec.h"
#include "localizer/live/codec/proto_values.h"
#include "mapstore/map/shift_report_check.h"

namespace shiftmap::live {
namespace {

// A link may carry a signature of its server.
constexpr std::size_t kMaxLinkBytes = 8192;

template <typename Proto>
void NamesToProto(const MapAction& action, Proto* out) {
  out->set_action_id(action.action_id);
  out->set_map_id(action.map_id);
  out->set_map_version(action.map_version);
}

Status CheckText(const char* field,
                 const std::string& text,
                 std::size_t longest = kMaxReportTextBytes) {
  if (text.size() <= longest) return OkStatus();
  return InvalidArgument("{}: {} bytes, expected at most {}", field, text.size(), longest);
}

template <typename Action, typename Proto>
StatusOr<Action> NamesFromProto(const Proto& in) {
  SHIFTMAP_RETURN_IF_ERROR(CheckText("action_id", in.action_id()));
  SHIFTMAP_RETURN_IF_ERROR(CheckText("map_id", in.map_id()));
  SHIFTMAP_RETURN_IF_ERROR(CheckText("map_version", in.map_version()));
  Action action;
  action.action_id = in.action_id();
  action.map_id = in.map_id();
  action.map_version = in.map_version();
  return action;
}

void Fill(const ActionState& action, proto::ActionState* out) {
  out->set_action_id(action.action_id);
  out->set_type(action.type);
  out->set_status(static_cast<proto::ActionStatus>(action.status));
  out->set_result(action.result);
}

StatusOr<ActionState> FromProto(const proto::ActionState& in) {
  if (in.status() < proto::WAITING || in.status() > proto::FAILED) {
    return InvalidArgument("action status {}, expected 0..{}",
                           static_cast<int>(in.status()),
                           static_cast<int>(proto::FAILED));
  }
  return ActionState{
      in.action_id(), in.type(), static_cast<ActionStatus>(in.status()), in.result()};
}

}  // namespace

void ToProto(const DownloadMap& action, proto::DownloadMap* out) {
  NamesToProto(action, out);
  out->set_link(action.link);
  out->set_sha256(action.sha256);
}

void ToProto(const EnableMap& action, proto::EnableMap* out) { NamesToProto(action, out); }

void ToProto(const DeleteMap& action, proto::DeleteMap* out) { NamesToProto(action, out); }

void ToProto(const InitializePosition& action, proto::InitializePosition* out) {
  out->set_action_id(action.action_id);
  out->set_map_id(action.map_id);
  ToProto(action.pose, out->mutable_pose());
  out->set_check(action.check);
}

void ToProto(const MapDownloadProgress& progress, proto::MapDownloadProgress* out) {
  out->set_action_id(progress.action_id);
  out->set_ended(progress.ended);
  out->set_code(static_cast<int>(progress.status.code()));
  out->set_message(Message(progress.status));
}

void ToProto(const FleetState& state, proto::FleetState* out) {
  for (const FleetState::Map& map : state.maps) {
    proto::FleetState::Map* entry = out->add_map();
    entry->set_map_id(map.map_id);
    entry->set_map_version(map.map_version);
    entry->set_enabled(map.enabled);
  }
  out->set_map_id(state.map_id);
  if (state.T_map_vehicle) {
    const Se2& T = *state.T_map_vehicle;
    for (const double value : {T.x(), T.y(), T.yaw()}) out->add_pose(value);
  }
  out->set_localized(state.localized);
  out->set_localization_score(state.localization_score);
  if (state.deviation_range_m) out->set_deviation_range_m(*state.deviation_range_m);
  for (const FleetError& error : state.errors) {
    proto::FleetState::Error* entry = out->add_error();
    entry->set_type(error.type);
    entry->set_level(error.level);
    entry->set_description(error.description);
    for (const auto& [key, value] : error.references) {
      proto::FleetState::Reference* reference = entry->add_reference();
      reference->set_key(key);
      reference->set_value(value);
    }
  }
  for (const ActionState& action : state.actions) Fill(action, out->add_action());
}

StatusOr<DownloadMap> FromProto(const proto::DownloadMap& in) {
  SHIFTMAP_ASSIGN_OR_RETURN(DownloadMap action, NamesFromProto<DownloadMap>(in));
  SHIFTMAP_RETURN_IF_ERROR(CheckText("link", in.link(), kMaxLinkBytes));
  SHIFTMAP_RETURN_IF_ERROR(CheckText("sha256", in.sha256()));
  action.link = in.link();
  action.sha256 = in.sha256();
  return action;
}

StatusOr<EnableMap> FromProto(const proto::EnableMap& in) { return NamesFromProto<EnableMap>(in); }

StatusOr<DeleteMap> FromProto(const proto::DeleteMap& in) { return NamesFromProto<DeleteMap>(in); }

StatusOr<InitializePosition> FromProto(const proto::InitializePosition& in) {
  SHIFTMAP_RETURN_IF_ERROR(CheckText("action_id", in.action_id()));
  SHIFTMAP_RETURN_IF_ERROR(CheckText("map_id", in.map_id()));
  InitializePosition action;
  action.action_id = in.action_id();
  action.map_id = in.map_id();
  action.check = in.check();
  SHIFTMAP_ASSIGN_OR_RETURN(action.pose, StartPoseFromProto(in.pose()));
  return action;
}

StatusOr<MapDownloadProgress> FromProto(const proto::MapDownloadProgress& in) {
  SHIFTMAP_RETURN_IF_ERROR(CheckText("action_id", in.action_id()));
  SHIFTMAP_RETURN_IF_ERROR(CheckText("message", in.message()));
  MapDownloadProgress progress{in.action_id(), in.ended(), OkStatus()};
  if (in.code() != 0) {
    progress.status = Status(static_cast<StatusCode>(in.code()), in.message());
  }
  return progress;
}

StatusOr<FleetState> FleetStateFromProto(const proto::FleetState& in) {
  FleetState state;
  for (const auto& map : in.map()) {
    state.maps.push_back({map.map_id(), map.map_version(), map.enabled()});
  }
  state.map_id = in.map_id();
  if (in.pose_size() == 3) state.T_map_vehicle = Se2(in.pose(0), in.pose(1), in.pose(2));
  state.localized = in.localized();
  state.localization_score = in.localization_score();
  if (in.has_deviation_range_m()) state.deviation_range_m = in.deviation_range_m();
  for (const auto& error : in.error()) {
    FleetError entry{error.type(), error.level(), error.description(), {}};
    for (const auto& reference : error.reference()) {
      entry.references.emplace_back(reference.key(), reference.value());
    }
    state.errors.push_back(std::move(entry));
  }
  for (const auto& action : in.action()) {
    SHIFTMAP_ASSIGN_OR_RETURN(ActionState entry, FromProto(action));
    state.actions.push_back(std::move(entry));
  }
  return state;
}

std::string EncodeActionStates(const std::vector<ActionState>& actions) {
  proto::ActionStates message;
  for (const ActionState& action : actions) Fill(action, message.add_action());
  return message.SerializeAsString();
}

StatusOr<std::vector<ActionState>> DecodeActionStates(std::string_view bytes) {
  SHIFTMAP_ASSIGN_OR_RETURN(const auto message, ParseProto<proto::ActionStates>(bytes));
  std::vector<ActionState> actions;
  for (const auto& action : message.action()) {
    SHIFTMAP_ASSIGN_OR_RETURN(ActionState entry, FromProto(action));
    actions.push_back(std::move(entry));
  }
  return actions;
}

}  // namespace shiftmap::live
