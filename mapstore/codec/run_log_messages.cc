// SPDX-License-Identifier: Apache-2.0
#include "mapstore/codec/run_log_messages.h"

#include <google/protobuf/arena.h>
#include <google/protobuf/descriptor.pb.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>

#include "mapstore/codec/parse_proto.h"
#include "mapstore/codec/run_log_proto.h"
#include "mapstore/map/shift_report_check.h"

namespace shiftmap {
namespace {

constexpr double kMillimetresPerMetre = 1000.0;

template <typename Proto>
Status ParseItem(std::string_view bytes, Proto* message) {
  if (bytes.size() > kMaxItemBytes) {
    return InvalidArgument("{} message of {} bytes, expected at most {}",
                           Proto::descriptor()->full_name(),
                           bytes.size(),
                           kMaxItemBytes);
  }
  return ParseProto(bytes, message);
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
  message.set_run_uuid(info.uuid);
  message.set_area(info.area);
  return message.SerializeAsString();
}

std::string EncodeOdometry(const OdometrySample& sample) {
  proto::Odometry message;
  ToProto(sample, &message);
  return message.SerializeAsString();
}

std::string EncodeScan(const Scan& scan) {
  proto::LandmarkScan message;
  ToProto(scan, &message);
  return message.SerializeAsString();
}

std::string EncodeLidarScan(const LidarScan& scan) {
  proto::LidarScan message;
  ToProto(scan, &message);
  return message.SerializeAsString();
}

void ToProto(const OdometrySample& sample, proto::Odometry* out) {
  out->set_stamp_ns(ToNanoseconds(sample.stamp));
  out->set_v_mps(sample.v_mps);
  out->set_omega_radps(sample.omega_radps);
}

void ToProto(const Scan& scan, proto::LandmarkScan* out) {
  out->set_stamp_ns(ToNanoseconds(scan.stamp));
  for (const Observation& observation : scan.observations) {
    ToProto(observation, out->add_observation());
  }
}

void ToProto(const LidarScan& scan, proto::LidarScan* out) {
  const LidarSensor& sensor = scan.sensor;
  out->set_stamp_ns(ToNanoseconds(scan.stamp));
  out->set_field_of_view_rad(sensor.field_of_view_rad);
  out->set_max_range_m(sensor.max_range_m);
  out->set_lidar_x_m(sensor.T_vehicle_lidar.x());
  out->set_lidar_y_m(sensor.T_vehicle_lidar.y());
  out->set_lidar_yaw_rad(sensor.T_vehicle_lidar.yaw());
  out->mutable_range_step_mm()->Reserve(static_cast<int>(scan.ranges_m.size()));
  std::int32_t before_mm = 0;
  for (const float range_m : scan.ranges_m) {
    const auto range_mm =
        static_cast<std::int32_t>(std::lround(kMillimetresPerMetre * static_cast<double>(range_m)));
    out->add_range_step_mm(range_mm - std::exchange(before_mm, range_mm));
  }
}

StatusOr<OdometrySample> FromProto(const proto::Odometry& in) {
  OdometrySample sample;
  sample.stamp = StampFromNanoseconds(in.stamp_ns());
  sample.v_mps = in.v_mps();
  sample.omega_radps = in.omega_radps();
  SHIFTMAP_RETURN_IF_ERROR(ValidateEvent(sample));
  return sample;
}

StatusOr<Scan> FromProto(const proto::LandmarkScan& in) {
  Scan scan;
  scan.stamp = StampFromNanoseconds(in.stamp_ns());
  scan.observations.reserve(static_cast<std::size_t>(in.observation_size()));
  for (const proto::LandmarkObservation& item : in.observation()) {
    auto observation = FromProto(item);
    if (!observation.ok()) {
      return InvalidArgument(
          "scan at {:.6f} s: {}", ToSecondsSinceEpoch(scan.stamp), Message(observation.status()));
    }
    scan.observations.push_back(*std::move(observation));
  }
  SHIFTMAP_RETURN_IF_ERROR(ValidateEvent(scan));
  return scan;
}

StatusOr<LidarScan> FromProto(const proto::LidarScan& in) {
  LidarScan scan;
  scan.stamp = StampFromNanoseconds(in.stamp_ns());
  scan.sensor.field_of_view_rad = in.field_of_view_rad();
  scan.sensor.max_range_m = in.max_range_m();
  scan.sensor.T_vehicle_lidar = Se2(in.lidar_x_m(), in.lidar_y_m(), in.lidar_yaw_rad());
  // One more than allowed shows that there are too many.
  const std::size_t beams =
      std::min(static_cast<std::size_t>(in.range_step_mm_size()), LidarScan::kMaxBeams + 1);
  scan.ranges_m.reserve(beams);
  std::int64_t range_mm = 0;
  for (std::size_t beam = 0; beam < beams; ++beam) {
    range_mm += in.range_step_mm(static_cast<int>(beam));
    scan.ranges_m.push_back(
        static_cast<float>(static_cast<double>(range_mm) / kMillimetresPerMetre));
  }
  SHIFTMAP_RETURN_IF_ERROR(ValidateEvent(scan));
  return scan;
}

StatusOr<RunInfo> DecodeRunInfo(std::string_view bytes) {
  proto::RunInfo message;
  SHIFTMAP_RETURN_IF_ERROR(ParseItem(bytes, &message));
  if (!message.run_uuid().empty() && !IsUuid(message.run_uuid())) {
    return InvalidArgument("run_uuid: neither empty nor an RFC 4122 UUID");
  }
  return RunInfo{
      message.vehicle(), message.source(), LowerCaseUuid(message.run_uuid()), message.area()};
}

StatusOr<OdometrySample> DecodeOdometry(std::string_view bytes) {
  proto::Odometry message;
  SHIFTMAP_RETURN_IF_ERROR(ParseItem(bytes, &message));
  return FromProto(message);
}

// In an arena, as a scan of many observations would be as many allocations.
StatusOr<Scan> DecodeScan(std::string_view bytes) {
  google::protobuf::Arena arena;
  auto* message = google::protobuf::Arena::CreateMessage<proto::LandmarkScan>(&arena);
  SHIFTMAP_RETURN_IF_ERROR(ParseItem(bytes, message));
  return FromProto(*message);
}

StatusOr<LidarScan> DecodeLidarScan(std::string_view bytes) {
  proto::LidarScan message;
  SHIFTMAP_RETURN_IF_ERROR(ParseItem(bytes, &message));
  return FromProto(message);
}

}  // namespace shiftmap
