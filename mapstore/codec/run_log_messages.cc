// SPDX-License-Identifier: Apache-2.0
#include "mapstore/codec/run_log_messages.h"

#include <google/protobuf/descriptor.pb.h>

#include <climits>

#include "proto/run_log.pb.h"

namespace shiftmap {
namespace {

template <typename Proto>
StatusOr<Proto> Parse(std::string_view bytes) {
  Proto message;
  if (bytes.size() > INT_MAX ||
      !message.ParseFromArray(bytes.data(), static_cast<int>(bytes.size()))) {
    return InvalidArgument(
        "{} bytes that are not a {} message", bytes.size(), Proto::descriptor()->full_name());
  }
  return message;
}

void ToProto(const Observation& observation, proto::LandmarkObservation* out) {
  out->set_signature(observation.signature.text());
  if (observation.kind == Observation::Kind::kRangeBearing) {
    proto::RangeBearing* measurement = out->mutable_range_bearing();
    measurement->set_range_m(observation.z.x());
    measurement->set_bearing_rad(observation.z.y());
  } else {
    proto::PositionInVehicle* measurement = out->mutable_position_in_vehicle();
    measurement->set_x_m(observation.z.x());
    measurement->set_y_m(observation.z.y());
  }
  if (observation.cov_z) {
    const Eigen::Matrix2d& cov = *observation.cov_z;
    proto::Covariance2* covariance = out->mutable_covariance();
    covariance->set_c00(cov(0, 0));
    covariance->set_c01(cov(0, 1));
    covariance->set_c11(cov(1, 1));
  }
}

StatusOr<Observation> FromProto(const proto::LandmarkObservation& in) {
  Observation observation;
  observation.signature = Signature(in.signature());
  switch (in.measurement_case()) {
    case proto::LandmarkObservation::kRangeBearing:
      observation.kind = Observation::Kind::kRangeBearing;
      observation.z = {in.range_bearing().range_m(), in.range_bearing().bearing_rad()};
      break;
    case proto::LandmarkObservation::kPositionInVehicle:
      observation.kind = Observation::Kind::kCartesian;
      observation.z = {in.position_in_vehicle().x_m(), in.position_in_vehicle().y_m()};
      break;
    case proto::LandmarkObservation::MEASUREMENT_NOT_SET:
      return InvalidArgument("landmark '{}': neither range_bearing nor position_in_vehicle",
                             in.signature());
  }
  if (in.has_covariance()) {
    Eigen::Matrix2d cov;
    cov << in.covariance().c00(), in.covariance().c01(), in.covariance().c01(),
        in.covariance().c11();
    observation.cov_z = cov;
  }
  return observation;
}

}  // namespace

std::string RunLogSchema() {
  google::protobuf::FileDescriptorSet set;
  proto::RunInfo::descriptor()->file()->CopyTo(set.add_file());
  return set.SerializeAsString();
}

std::string EncodeRunInfo(const RunInfo& info) {
  proto::RunInfo message;
  message.set_vehicle(info.vehicle);
  message.set_source(info.source);
  return message.SerializeAsString();
}

std::string EncodeOdometry(const OdometrySample& sample) {
  proto::Odometry message;
  message.set_stamp_ns(ToNanoseconds(sample.stamp));
  message.set_v_mps(sample.v_mps);
  message.set_omega_radps(sample.omega_radps);
  return message.SerializeAsString();
}

std::string EncodeScan(const Scan& scan) {
  proto::LandmarkScan message;
  message.set_stamp_ns(ToNanoseconds(scan.stamp));
  for (const Observation& observation : scan.observations) {
    ToProto(observation, message.add_observation());
  }
  return message.SerializeAsString();
}

StatusOr<RunInfo> DecodeRunInfo(std::string_view bytes) {
  SHIFTMAP_ASSIGN_OR_RETURN(const proto::RunInfo message, Parse<proto::RunInfo>(bytes));
  return RunInfo{message.vehicle(), message.source()};
}

StatusOr<OdometrySample> DecodeOdometry(std::string_view bytes) {
  SHIFTMAP_ASSIGN_OR_RETURN(const proto::Odometry message, Parse<proto::Odometry>(bytes));
  OdometrySample sample;
  sample.stamp = StampFromNanoseconds(message.stamp_ns());
  sample.v_mps = message.v_mps();
  sample.omega_radps = message.omega_radps();
  SHIFTMAP_RETURN_IF_ERROR(ValidateEvent(sample));
  return sample;
}

StatusOr<Scan> DecodeScan(std::string_view bytes) {
  SHIFTMAP_ASSIGN_OR_RETURN(const proto::LandmarkScan message, Parse<proto::LandmarkScan>(bytes));
  Scan scan;
  scan.stamp = StampFromNanoseconds(message.stamp_ns());
  scan.observations.reserve(static_cast<std::size_t>(message.observation_size()));
  for (const proto::LandmarkObservation& in : message.observation()) {
    auto observation = FromProto(in);
    if (!observation.ok()) {
      return InvalidArgument(
          "scan at {:.6f} s: {}", ToSecondsSinceEpoch(scan.stamp), Message(observation.status()));
    }
    scan.observations.push_back(*std::move(observation));
  }
  SHIFTMAP_RETURN_IF_ERROR(ValidateEvent(scan));
  return scan;
}

}  // namespace shiftmap
