// SPDX-License-Identifier: Apache-2.0
#include "localizer/recording/codec/recording_codec.h"

#include <google/protobuf/descriptor.pb.h>

#include <cmath>
#include <set>

#include "localizer/live/codec/hypothesis_codec.h"
#include "localizer/live/codec/proto_values.h"
#include "mapstore/codec/parse_proto.h"
#include "mapstore/core/stamp_check.h"
#include "proto/core/check.h"
#include "proto/foxglove.pb.h"
#include "proto/map.pb.h"
#include "proto/recording.pb.h"

namespace shiftmap {
namespace {

using google::protobuf::FileDescriptor;

// The generated types register themselves only in a program that uses them.
void LinkSchemas() {
  google::protobuf::LinkMessageReflection<foxglove::SceneUpdate>();
  google::protobuf::LinkMessageReflection<proto::Map>();
  google::protobuf::LinkMessageReflection<proto::RecordedShift>();
}

// What a file uses stands before it.
void AddFile(const FileDescriptor& file,
             std::set<std::string>* added,
             google::protobuf::FileDescriptorSet* set) {
  if (!added->insert(file.name()).second) return;
  for (int i = 0; i < file.dependency_count(); ++i) AddFile(*file.dependency(i), added, set);
  file.CopyTo(set->add_file());
}

// A stamp that a recording can have.
Status TakeStamp(std::int64_t stamp_ns, Stamp* stamp) {
  *stamp = StampFromNanoseconds(stamp_ns);
  return ValidateStamp(*stamp);
}

Status CheckFinite(const char* what, std::initializer_list<double> values) {
  for (const double value : values) {
    if (!std::isfinite(value))
      return InvalidArgument("{}: {}, expected finite numbers", what, value);
  }
  return OkStatus();
}

Status CheckFinite(const HypothesisView& view) {
  SHIFTMAP_RETURN_IF_ERROR(
      CheckFinite("hypotheses: probability", {view.probability_left_out, view.dropped_mass_max}));
  for (const HypothesisView::Node& node : view.nodes) {
    const Se2 pose = node.T_map_vehicle.value_or(Se2());
    SHIFTMAP_RETURN_IF_ERROR(
        CheckFinite("hypotheses: node", {node.probability, pose.x(), pose.y(), pose.yaw()}));
  }
  for (const HypothesisView::VisitView& visit : view.visits) {
    for (const auto& [mode, probability] : visit.probabilities) {
      SHIFTMAP_RETURN_IF_ERROR(CheckFinite("hypotheses: visit", {probability}));
    }
  }
  return OkStatus();
}

}  // namespace

std::string SchemaNamed(std::string_view schema_name) {
  LinkSchemas();
  const auto* message = google::protobuf::DescriptorPool::generated_pool()->FindMessageTypeByName(
      std::string(schema_name));
  SHIFTMAP_CHECK(message != nullptr, "no message {}", schema_name);
  google::protobuf::FileDescriptorSet set;
  std::set<std::string> added;
  AddFile(*message->file(), &added, &set);
  return set.SerializeAsString();
}

std::string Encode(const RecordedShift& shift) {
  proto::RecordedShift out;
  out.set_vehicle(shift.vehicle);
  out.set_area(shift.area);
  out.set_version(shift.version.value());
  out.set_content_hash(shift.content_hash);
  out.set_run_uuid(shift.run_uuid);
  out.set_software(shift.software);
  out.set_calibrated_vehicle(shift.calibrated_vehicle);
  return out.SerializeAsString();
}

std::string Encode(const live::PoseEvent& pose) {
  proto::PoseEvent out;
  out.set_stamp_ns(ToNanoseconds(pose.stamp));
  live::ToProto(pose.pose, out.mutable_pose());
  out.set_state(live::StateToProto(pose.state));
  return out.SerializeAsString();
}

std::string Encode(const StateChange& change) {
  const StateEvidence& evidence = change.evidence;
  proto::StateChanged out;
  out.set_stamp_ns(ToNanoseconds(change.stamp));
  out.set_from(live::StateToProto(change.from));
  out.set_to(live::StateToProto(change.to));
  out.set_agreeing(evidence.support.agreeing);
  out.set_failing(evidence.support.failing);
  out.set_nis_sum(evidence.support.nis_sum);
  out.set_updates(evidence.support.updates);
  out.set_signature(evidence.signature.text());
  out.set_mode(evidence.mode.value());
  out.set_log_odds(evidence.log_odds);
  out.set_sightings(evidence.sightings);
  return out.SerializeAsString();
}

std::string Encode(const DecisionChange& change) {
  proto::DecisionChanged out;
  out.set_stamp_ns(ToNanoseconds(change.stamp));
  proto::Decision* decision = out.mutable_decision();
  decision->set_signature(change.decision.signature.text());
  decision->set_mode(change.decision.mode.value());
  decision->set_stamp_ns(ToNanoseconds(change.decision.stamp));
  decision->set_log_odds(change.decision.log_odds);
  out.set_withdrawn(change.withdrawn);
  return out.SerializeAsString();
}

std::string Encode(const ScanInnovations& innovations) {
  proto::ScanInnovations out;
  out.set_stamp_ns(ToNanoseconds(innovations.stamp));
  out.set_quality(innovations.quality);
  for (const RecordedInnovation& innovation : innovations.innovations) {
    proto::Innovation* to = out.add_innovation();
    to->set_signature(innovation.signature.text());
    to->set_mode(innovation.mode.value());
    to->set_nu_x_m(innovation.nu.x());
    to->set_nu_y_m(innovation.nu.y());
    to->set_s_xx_m2(innovation.S(0, 0));
    to->set_s_xy_m2(innovation.S(0, 1));
    to->set_s_yy_m2(innovation.S(1, 1));
    to->set_nis(innovation.nis);
  }
  return out.SerializeAsString();
}

std::string Encode(const HypothesesSample& sample) {
  proto::HypothesesSample out;
  out.set_stamp_ns(ToNanoseconds(sample.stamp));
  live::ToProto(sample.view, out.mutable_hypotheses());
  for (const double weight : sample.leaf_weights) out.add_leaf_weight(weight);
  return out.SerializeAsString();
}

Status Decode(std::string_view bytes, RecordedShift* shift) {
  SHIFTMAP_ASSIGN_OR_RETURN(const auto in, ParseProto<proto::RecordedShift>(bytes));
  *shift = {in.vehicle(),
            in.area(),
            VersionNumber(in.version()),
            in.content_hash(),
            in.run_uuid(),
            in.software(),
            in.calibrated_vehicle()};
  return OkStatus();
}

Status Decode(std::string_view bytes, live::PoseEvent* pose) {
  SHIFTMAP_ASSIGN_OR_RETURN(const auto in, ParseProto<proto::PoseEvent>(bytes));
  SHIFTMAP_RETURN_IF_ERROR(TakeStamp(in.stamp_ns(), &pose->stamp));
  SHIFTMAP_ASSIGN_OR_RETURN(pose->pose, live::PoseFromProto(in.pose()));
  SHIFTMAP_ASSIGN_OR_RETURN(pose->state, live::StateFromProto(in.state()));
  return OkStatus();
}

Status Decode(std::string_view bytes, StateChange* change) {
  SHIFTMAP_ASSIGN_OR_RETURN(const auto in, ParseProto<proto::StateChanged>(bytes));
  StateEvidence& evidence = change->evidence;
  SHIFTMAP_RETURN_IF_ERROR(TakeStamp(in.stamp_ns(), &change->stamp));
  SHIFTMAP_RETURN_IF_ERROR(CheckFinite("state change", {in.nis_sum(), in.log_odds()}));
  SHIFTMAP_ASSIGN_OR_RETURN(change->from, live::StateFromProto(in.from()));
  SHIFTMAP_ASSIGN_OR_RETURN(change->to, live::StateFromProto(in.to()));
  evidence.stamp = change->stamp;
  evidence.support.agreeing = in.agreeing();
  evidence.support.failing = in.failing();
  evidence.support.nis_sum = in.nis_sum();
  evidence.support.updates = in.updates();
  evidence.signature = Signature(in.signature());
  evidence.mode = ModeNumber(in.mode());
  evidence.log_odds = in.log_odds();
  evidence.sightings = in.sightings();
  return OkStatus();
}

Status Decode(std::string_view bytes, DecisionChange* change) {
  SHIFTMAP_ASSIGN_OR_RETURN(const auto in, ParseProto<proto::DecisionChanged>(bytes));
  SHIFTMAP_RETURN_IF_ERROR(TakeStamp(in.stamp_ns(), &change->stamp));
  SHIFTMAP_RETURN_IF_ERROR(TakeStamp(in.decision().stamp_ns(), &change->decision.stamp));
  SHIFTMAP_RETURN_IF_ERROR(CheckFinite("decision", {in.decision().log_odds()}));
  change->decision.signature = Signature(in.decision().signature());
  change->decision.mode = ModeNumber(in.decision().mode());
  change->decision.log_odds = in.decision().log_odds();
  change->withdrawn = in.withdrawn();
  return OkStatus();
}

Status Decode(std::string_view bytes, ScanInnovations* innovations) {
  SHIFTMAP_ASSIGN_OR_RETURN(const auto in, ParseProto<proto::ScanInnovations>(bytes));
  SHIFTMAP_RETURN_IF_ERROR(TakeStamp(in.stamp_ns(), &innovations->stamp));
  SHIFTMAP_RETURN_IF_ERROR(CheckFinite("innovations: quality", {in.quality()}));
  innovations->quality = in.quality();
  for (const proto::Innovation& from : in.innovation()) {
    SHIFTMAP_RETURN_IF_ERROR(CheckFinite("innovation",
                                         {from.nu_x_m(),
                                          from.nu_y_m(),
                                          from.s_xx_m2(),
                                          from.s_xy_m2(),
                                          from.s_yy_m2(),
                                          from.nis()}));
    RecordedInnovation& to = innovations->innovations.emplace_back();
    to.signature = Signature(from.signature());
    to.mode = ModeNumber(from.mode());
    to.nu = {from.nu_x_m(), from.nu_y_m()};
    to.S << from.s_xx_m2(), from.s_xy_m2(), from.s_xy_m2(), from.s_yy_m2();
    to.nis = from.nis();
  }
  return OkStatus();
}

Status Decode(std::string_view bytes, HypothesesSample* sample) {
  SHIFTMAP_ASSIGN_OR_RETURN(const auto in, ParseProto<proto::HypothesesSample>(bytes));
  SHIFTMAP_RETURN_IF_ERROR(TakeStamp(in.stamp_ns(), &sample->stamp));
  SHIFTMAP_ASSIGN_OR_RETURN(sample->view, live::HypothesesFromProto(in.hypotheses()));
  for (const double weight : in.leaf_weight()) {
    SHIFTMAP_RETURN_IF_ERROR(CheckFinite("leaf weight", {weight}));
    sample->leaf_weights.push_back(weight);
  }
  return CheckFinite(sample->view);
}

}  // namespace shiftmap
