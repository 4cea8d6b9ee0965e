// SPDX-License-Identifier: Apache-2.0
#include "localizer/live/codec/fleet_codec.h"
#include "localizer/live/codec/hypothesis_codec.h"
#include "localizer/live/codec/live_codec.h"
#include "localizer/live/codec/proto_values.h"

namespace shiftmap::live {
namespace {

// An enumerator of a later version says at least that the stamps do not agree.
TimeLine TimeLineFromProto(proto::TimeLine time_line) {
  if (time_line == proto::AGREES) return TimeLine::kAgrees;
  return time_line == proto::LATE ? TimeLine::kLate : TimeLine::kFuture;
}

void FillState(const ServiceState& state, proto::ServiceState* out) {
  out->set_running(state.running);
  out->set_area(state.area);
  out->set_version(state.version.value());
  out->set_content_hash(state.content_hash);
  out->set_report_uuid(state.report_uuid);
  out->set_report_path(state.report_path);
  out->set_resumed(state.resumed);
  out->set_localizer_state(StateToProto(state.localizer_state));
  out->set_stamp_ns(ToNanoseconds(state.stamp));
  if (state.pose) ToProto(*state.pose, out->mutable_pose());
  out->set_scans(state.scans);
  out->set_decisions(state.decisions);
  out->set_overruns(state.overruns);
  out->set_calibrated_vehicle(state.calibrated_vehicle);
  out->set_time_line(static_cast<proto::TimeLine>(state.time_line));
  out->set_clock_jumps(state.clock_jumps);
  for (const DroppedCount& dropped : state.dropped) {
    proto::Dropped* entry = out->add_dropped();
    entry->set_reason(dropped.reason);
    entry->set_count(dropped.count);
  }
}

StatusOr<ServiceState> FromProto(const proto::ServiceState& in) {
  ServiceState state;
  state.running = in.running();
  state.area = in.area();
  state.version = VersionNumber(in.version());
  state.content_hash = in.content_hash();
  state.report_uuid = in.report_uuid();
  state.report_path = in.report_path();
  state.resumed = in.resumed();
  SHIFTMAP_ASSIGN_OR_RETURN(state.localizer_state, StateFromProto(in.localizer_state()));
  state.stamp = StampFromNanoseconds(in.stamp_ns());
  if (in.has_pose()) {
    SHIFTMAP_ASSIGN_OR_RETURN(state.pose, PoseFromProto(in.pose()));
  }
  state.scans = in.scans();
  state.decisions = in.decisions();
  state.overruns = in.overruns();
  state.calibrated_vehicle = in.calibrated_vehicle();
  state.time_line = TimeLineFromProto(in.time_line());
  state.clock_jumps = in.clock_jumps();
  for (const proto::Dropped& dropped : in.dropped()) {
    state.dropped.push_back({dropped.reason(), dropped.count()});
  }
  return state;
}

void Fill(const Reply& reply, proto::Event* event) {
  proto::Reply* out = event->mutable_reply();
  out->set_id(reply.id);
  out->set_code(static_cast<int>(reply.status.code()));
  out->set_message(Message(reply.status));
  if (reply.state) FillState(*reply.state, out->mutable_state());
  if (reply.hypotheses) ToProto(*reply.hypotheses, out->mutable_hypotheses());
  if (reply.fleet_state) ToProto(*reply.fleet_state, out->mutable_fleet_state());
}

void Fill(const DownloadMap& download, proto::Event* event) {
  ToProto(download, event->mutable_map_download());
}

void Fill(const PoseEvent& pose, proto::Event* event) {
  event->mutable_pose()->set_stamp_ns(ToNanoseconds(pose.stamp));
  ToProto(pose.pose, event->mutable_pose()->mutable_pose());
  event->mutable_pose()->set_state(StateToProto(pose.state));
}

void Fill(const StateEvent& state, proto::Event* event) {
  event->mutable_state()->set_stamp_ns(ToNanoseconds(state.stamp));
  event->mutable_state()->set_state(StateToProto(state.state));
}

void Fill(const Decision& decision, proto::Event* event) {
  proto::Decision* out = event->mutable_decision();
  out->set_signature(decision.signature.text());
  out->set_mode(decision.mode.value());
  out->set_stamp_ns(ToNanoseconds(decision.stamp));
  out->set_log_odds(decision.log_odds);
}

StatusOr<Event> ReplyFromProto(const proto::Reply& in) {
  Reply reply;
  reply.id = in.id();
  if (in.code() != 0) {
    reply.status = Status(static_cast<StatusCode>(in.code()), in.message());
  }
  if (in.has_state()) {
    SHIFTMAP_ASSIGN_OR_RETURN(reply.state, FromProto(in.state()));
  }
  if (in.has_hypotheses()) {
    SHIFTMAP_ASSIGN_OR_RETURN(reply.hypotheses, HypothesesFromProto(in.hypotheses()));
  }
  if (in.has_fleet_state()) {
    SHIFTMAP_ASSIGN_OR_RETURN(reply.fleet_state, FleetStateFromProto(in.fleet_state()));
  }
  return Event(std::move(reply));
}

StatusOr<Event> PoseEventFromProto(const proto::PoseEvent& in) {
  PoseEvent event;
  event.stamp = StampFromNanoseconds(in.stamp_ns());
  SHIFTMAP_ASSIGN_OR_RETURN(event.pose, PoseFromProto(in.pose()));
  SHIFTMAP_ASSIGN_OR_RETURN(event.state, StateFromProto(in.state()));
  return Event(event);
}

}  // namespace

std::string EncodeEvent(const Event& event) {
  proto::Event message;
  std::visit([&](const auto& item) { Fill(item, &message); }, event);
  return message.SerializeAsString();
}

StatusOr<Event> DecodeEvent(std::string_view bytes) {
  SHIFTMAP_ASSIGN_OR_RETURN(const auto message, ParseProto<proto::Event>(bytes));
  switch (message.event_case()) {
    case proto::Event::kReply:
      return ReplyFromProto(message.reply());
    case proto::Event::kPose:
      return PoseEventFromProto(message.pose());
    case proto::Event::kState: {
      StateEvent event;
      event.stamp = StampFromNanoseconds(message.state().stamp_ns());
      SHIFTMAP_ASSIGN_OR_RETURN(event.state, StateFromProto(message.state().state()));
      return Event(event);
    }
    case proto::Event::kDecision:
      return Event(Decision{.signature = Signature(message.decision().signature()),
                            .mode = ModeNumber(message.decision().mode()),
                            .stamp = StampFromNanoseconds(message.decision().stamp_ns()),
                            .log_odds = message.decision().log_odds()});
    case proto::Event::kMapDownload: {
      SHIFTMAP_ASSIGN_OR_RETURN(DownloadMap download, FromProto(message.map_download()));
      return Event(std::move(download));
    }
    case proto::Event::EVENT_NOT_SET:
      break;
  }
  return InvalidArgument("event of an unknown kind");
}

}  // namespace shiftmap::live
