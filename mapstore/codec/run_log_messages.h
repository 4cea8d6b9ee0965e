// SPDX-License-Identifier: Apache-2.0
//
// The messages of a run log, to and from bytes. Inside codec/ only.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

#include "mapstore/run/run.h"
#include "proto/core/status.h"

namespace shiftmap {

/// A topic of a run log and the message type that it carries.
struct RunLogTopic {
  std::string_view topic;
  std::string_view schema_name;
};

inline constexpr RunLogTopic kRunInfoTopic{"/run_info", "shiftmap.proto.RunInfo"};
inline constexpr RunLogTopic kOdometryTopic{"/odometry", "shiftmap.proto.Odometry"};
inline constexpr RunLogTopic kLandmarksTopic{"/landmarks", "shiftmap.proto.LandmarkScan"};
inline constexpr RunLogTopic kLidarTopic{"/lidar", "shiftmap.proto.LidarScan"};

/// The FileDescriptorSet that describes all of them, as bytes.
std::string RunLogSchema();

std::string EncodeRunInfo(const RunInfo& info);
std::string EncodeOdometry(const OdometrySample& sample);
std::string EncodeScan(const Scan& scan);
std::string EncodeLidarScan(const LidarScan& scan);

/// Size of a message up to which it is an item of a run: a scan of ten thousand observations.
/// [byte]
inline constexpr std::size_t kMaxItemBytes = std::size_t{1} << 20;

/// Errors: kInvalidArgument if the bytes are not such a message, are more than kMaxItemBytes, or
/// fail ValidateEvent.
StatusOr<RunInfo> DecodeRunInfo(std::string_view bytes);
StatusOr<OdometrySample> DecodeOdometry(std::string_view bytes);
StatusOr<Scan> DecodeScan(std::string_view bytes);
StatusOr<LidarScan> DecodeLidarScan(std::string_view bytes);

}  // namespace shiftmap
