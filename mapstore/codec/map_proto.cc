// SPDX-License-Identifier: Apache-2.0
#include "mapstore/codec/map_proto.h"

#include <google/protobuf/descriptor.h>

#include <chrono>
#include <cmath>
#include <cstddef>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "mapstore/codec/map_message.h"
#include "mapstore/core/magnitude.h"
#include "mapstore/core/utf8.h"
#include "mapstore/map/chain_rhythm.h"
#include "proto/core/check.h"

namespace shiftmap {
namespace {

using google::protobuf::FieldDescriptor;
using ProtoMessage = google::protobuf::Message;

// The field of a message that has a value's name.
const FieldDescriptor* FieldNamed(const ProtoMessage& message, const char* name) {
  const FieldDescriptor* field = message.GetDescriptor()->FindFieldByName(name);
  SHIFTMAP_CHECK(field != nullptr, "{} has no {}", message.GetTypeName(), name);
  return field;
}

// Values in the order of their names, to and from the fields of these names.
void SetValues(std::span<const char* const> names,
               std::span<const double> values,
               ProtoMessage* out) {
  for (std::size_t i = 0; i < names.size(); ++i) {
    out->GetReflection()->SetDouble(out, FieldNamed(*out, names[i]), values[i]);
  }
}

void GetValues(const ProtoMessage& in,
               std::span<const char* const> names,
               std::span<double*> values) {
  for (std::size_t i = 0; i < names.size(); ++i) {
    *values[i] = in.GetReflection()->GetDouble(in, FieldNamed(in, names[i]));
  }
}

Status CheckName(const std::string& what, const std::string& name) {
  if (IsUtf8(name)) return OkStatus();
  return InvalidArgument("{} '{}': the name is not UTF-8", what, name);
}

void ToProto(const Mode& mode, proto::MapMode* out) {
  out->set_mode(mode.number.value());
  out->set_x_m(mode.p_map_landmark.x());
  out->set_y_m(mode.p_map_landmark.y());
  out->set_cov_xx_m2(mode.cov_p_map_landmark(0, 0));
  out->set_cov_xy_m2(mode.cov_p_map_landmark(0, 1));
  out->set_cov_yy_m2(mode.cov_p_map_landmark(1, 1));
  out->set_last_seen_ns(ToNanoseconds(mode.last_seen));
}

Mode ModeFromProto(const proto::MapMode& in) {
  Mode mode;
  mode.number = ModeNumber(in.mode());
  mode.p_map_landmark = {in.x_m(), in.y_m()};
  mode.cov_p_map_landmark << in.cov_xx_m2(), in.cov_xy_m2(), in.cov_xy_m2(), in.cov_yy_m2();
  mode.last_seen = StampFromNanoseconds(in.last_seen_ns());
  return mode;
}

using Rates = google::protobuf::RepeatedField<double>;

// By rows.
void AddRates(const Eigen::MatrixXd& rates, Rates* out) {
  for (const auto& row : rates.rowwise()) {
    for (const double rate : row) out->Add(rate);
  }
}

StatusOr<Eigen::MatrixXd> RatesFromProto(const Rates& in, int states) {
  if (in.size() != states * states) {
    return InvalidArgument("rate_per_s: {} values, expected {}", in.size(), states * states);
  }
  for (const double rate : in) {
    if (!(std::abs(rate) <= kMaxMagnitude)) {
      return InvalidArgument("rate_per_s: {}, expected at most {}", rate, kMaxMagnitude);
    }
  }
  using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  return Eigen::MatrixXd(Eigen::Map<const RowMajor>(in.data(), states, states));
}

void ToProto(const ChainRhythm& rhythm, proto::MapRhythm* out) {
  out->set_period_s(
      std::chrono::duration_cast<std::chrono::seconds>(rhythm.calendar().period).count());
  for (const Eigen::MatrixXd& rates : rhythm.rate_matrices()) {
    AddRates(rates, out->add_phase()->mutable_rate_per_s());
  }
}

StatusOr<ChainRhythm> RhythmFromProto(const proto::MapRhythm& in, int states) {
  if (in.phase_size() > ChainRhythm::kMaxPhases) {
    return InvalidArgument(
        "rhythm: {} phases, expected at most {}", in.phase_size(), ChainRhythm::kMaxPhases);
  }
  std::vector<Eigen::MatrixXd> phases;
  for (const proto::RhythmPhase& phase : in.phase()) {
    SHIFTMAP_ASSIGN_OR_RETURN(Eigen::MatrixXd rates, RatesFromProto(phase.rate_per_s(), states));
    phases.push_back(std::move(rates));
  }
  const Duration period =
      in.period_s() == kRhythmWeek / std::chrono::seconds(1) ? kRhythmWeek : kRhythmDay;
  if (in.period_s() != period / std::chrono::seconds(1)) {
    return InvalidArgument("rhythm: period_s {}, expected a day or a week", in.period_s());
  }
  return ChainRhythm::Make(period, std::move(phases));
}

Status ToProto(const LandmarkGroup& group, proto::MapGroup* out) {
  SHIFTMAP_RETURN_IF_ERROR(CheckName("landmark", group.signature.text()));
  out->set_signature(group.signature.text());
  for (const Mode& mode : group.modes) ToProto(mode, out->add_mode());
  for (const double probability : group.probabilities) out->add_probability(probability);
  out->set_leave_rate_per_s(group.chain.leave_rate_per_s());
  if (!group.chain.uniform()) AddRates(group.chain.rate_matrix(), out->mutable_rate_per_s());
  if (const ChainRhythm* const rhythm = group.chain.rhythm()) {
    ToProto(*rhythm, out->mutable_rhythm());
  }
  for (const MergedMode& merged : group.merged) {
    proto::RetiredMode* retired = out->add_retired();
    retired->set_mode(merged.number.value());
    retired->set_into(merged.into.value());
  }
  return OkStatus();
}

StatusOr<ModeChain> ChainFromProto(const proto::MapGroup& in) {
  const int states = in.mode_size() + 1;
  if (in.rate_per_s().empty()) {
    const double rate = in.leave_rate_per_s();
    if (!(rate >= 0.0)) return InvalidArgument("leave_rate_per_s: {}, expected 0 or more", rate);
    return ModeChain::Uniform(in.mode_size(), rate);
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const Eigen::MatrixXd rates, RatesFromProto(in.rate_per_s(), states));
  return ModeChain::FromRates(rates);
}

StatusOr<LandmarkGroup> GroupFromProto(const proto::MapGroup& in) {
  if (static_cast<std::size_t>(in.mode_size()) > kMaxDecodedModes) {
    return InvalidArgument("{} modes, expected at most {}", in.mode_size(), kMaxDecodedModes);
  }
  LandmarkGroup group;
  group.signature = Signature(in.signature());
  for (const proto::MapMode& mode : in.mode()) group.modes.push_back(ModeFromProto(mode));
  group.probabilities =
      Eigen::Map<const Eigen::VectorXd>(in.probability().data(), in.probability_size());
  SHIFTMAP_ASSIGN_OR_RETURN(group.chain, ChainFromProto(in));
  if (in.has_rhythm()) {
    SHIFTMAP_ASSIGN_OR_RETURN(ChainRhythm rhythm,
                              RhythmFromProto(in.rhythm(), group.chain.states()));
    SHIFTMAP_ASSIGN_OR_RETURN(group.chain, group.chain.WithRhythm(std::move(rhythm)));
  }
  for (const proto::RetiredMode& retired : in.retired()) {
    group.merged.push_back({ModeNumber(retired.mode()), ModeNumber(retired.into())});
  }
  return group;
}

StatusOr<JointCovariance> CovarianceFromProto(const proto::Map& in,
                                              const std::vector<LandmarkGroup>& groups) {
  std::vector<Eigen::Matrix2d> diagonal;
  for (const LandmarkGroup& group : groups) {
    for (const Mode& mode : group.modes) diagonal.push_back(mode.cov_p_map_landmark);
  }
  std::vector<JointCovariance::CrossBlock> cross;
  std::pair<int, int> previous{-1, -1};
  for (const proto::CrossCovariance& block : in.cross_covariance()) {
    const std::pair<int, int> at{block.row(), block.column()};
    if (at.first < 0 || at.first >= at.second || at <= previous ||
        static_cast<std::size_t>(at.second) >= diagonal.size() || block.cov_m2_size() != 4) {
      return InvalidArgument(
          "cross_covariance ({}, {}) of {} values: expected row < column < {} in ascending order "
          "and 4 values",
          at.first,
          at.second,
          block.cov_m2_size(),
          diagonal.size());
    }
    previous = at;
    Eigen::Matrix2d value;
    value << block.cov_m2(0), block.cov_m2(1), block.cov_m2(2), block.cov_m2(3);
    cross.push_back({at.first, at.second, value});
  }
  return JointCovariance(std::move(diagonal), std::move(cross));
}

}  // namespace

Status ToProto(const MapSnapshot& map, proto::Map* out) {
  SHIFTMAP_RETURN_IF_ERROR(CheckName("area", map.area()));
  out->set_area(map.area());
  out->set_version(map.version().value());
  out->set_content_hash(map.content_hash());
  out->set_stamp_ns(ToNanoseconds(map.stamp()));
  for (const LandmarkGroup& group : map.groups()) {
    SHIFTMAP_RETURN_IF_ERROR(ToProto(group, out->add_group()));
  }
  for (const Mode& landmark : map.anonymous_landmarks()) {
    ToProto(landmark, out->add_anonymous_landmark());
  }
  for (const JointCovariance::CrossBlock& block : map.covariance().cross_blocks()) {
    proto::CrossCovariance* cross = out->add_cross_covariance();
    cross->set_row(block.row);
    cross->set_column(block.column);
    for (const auto& row : block.value.rowwise()) {
      for (const double value : row) cross->add_cov_m2(value);
    }
  }
  SetValues(
      kCalibrationNames, CalibrationValues(map.content().calibration), out->mutable_calibration());
  for (const VehicleCalibration& vehicle : map.vehicles()) {
    SHIFTMAP_RETURN_IF_ERROR(CheckName("vehicle", vehicle.vehicle));
    proto::MapVehicle* known = out->add_vehicle();
    known->set_vehicle(vehicle.vehicle);
    known->set_runs(vehicle.runs);
    known->set_stamp_ns(ToNanoseconds(vehicle.stamp));
    SetValues(kVehicleValueNames, VehicleValues(vehicle), known->mutable_values());
  }
  return OkStatus();
}

StatusOr<MapSnapshot> MapFromProto(const proto::Map& in) {
  MapContent content;
  content.stamp = StampFromNanoseconds(in.stamp_ns());
  for (const proto::MapGroup& group : in.group()) {
    auto decoded = GroupFromProto(group);
    if (!decoded.ok()) {
      return InvalidArgument("landmark '{}': {}", group.signature(), Message(decoded.status()));
    }
    content.groups.push_back(*std::move(decoded));
  }
  SHIFTMAP_ASSIGN_OR_RETURN(content.covariance, CovarianceFromProto(in, content.groups));
  for (const proto::MapMode& landmark : in.anonymous_landmark()) {
    content.anonymous_landmarks.push_back(ModeFromProto(landmark));
  }
  if (in.has_calibration()) {
    auto values = CalibrationValues(&content.calibration);
    GetValues(in.calibration(), kCalibrationNames, values);
  }
  for (const proto::MapVehicle& known : in.vehicle()) {
    VehicleCalibration& vehicle = content.vehicles.emplace_back();
    vehicle.vehicle = known.vehicle();
    vehicle.runs = known.runs();
    vehicle.stamp = StampFromNanoseconds(known.stamp_ns());
    auto values = VehicleValues(&vehicle);
    GetValues(known.values(), kVehicleValueNames, values);
  }
  SHIFTMAP_RETURN_IF_ERROR(ValidateMapContent(content));
  return MapSnapshot(in.area(), VersionNumber(in.version()), in.content_hash(), std::move(content));
}

}  // namespace shiftmap
