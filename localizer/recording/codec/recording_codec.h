// SPDX-License-Identifier: Apache-2.0
//
// The messages of a recording that are ours, to and from bytes.
#pragma once

#include <string>
#include <string_view>

#include "localizer/recording/shift_recording.h"
#include "proto/core/status.h"

namespace shiftmap {

/// A topic of a recording and the message type that it carries.
struct RecordingTopic {
  std::string_view topic;
  std::string_view schema_name;
};

inline constexpr RecordingTopic kShiftTopic{"/shift", "shiftmap.proto.RecordedShift"};
inline constexpr RecordingTopic kMapTopic{"/map", "shiftmap.proto.Map"};
inline constexpr RecordingTopic kPoseEventTopic{"/pose_estimate", "shiftmap.proto.PoseEvent"};
inline constexpr RecordingTopic kStateTopic{"/state", "shiftmap.proto.StateChanged"};
inline constexpr RecordingTopic kDecisionTopic{"/decisions", "shiftmap.proto.DecisionChanged"};
inline constexpr RecordingTopic kInnovationTopic{"/innovations", "shiftmap.proto.ScanInnovations"};
inline constexpr RecordingTopic kHypothesesTopic{"/hypotheses", "shiftmap.proto.HypothesesSample"};
inline constexpr RecordingTopic kPoseTopic{"/pose", "foxglove.PoseInFrame"};
inline constexpr RecordingTopic kTransformTopic{"/tf", "foxglove.FrameTransform"};
inline constexpr RecordingTopic kLogTopic{"/log", "foxglove.Log"};
inline constexpr RecordingTopic kMapSceneTopic{"/map/scene", "foxglove.SceneUpdate"};
inline constexpr RecordingTopic kLeafPosesTopic{"/hypotheses/poses", "foxglove.PosesInFrame"};
inline constexpr RecordingTopic kLeafSceneTopic{"/hypotheses/scene", "foxglove.SceneUpdate"};

/// The FileDescriptorSet of a message type and all that it uses, as bytes.
std::string SchemaNamed(std::string_view schema_name);

std::string Encode(const RecordedShift& shift);
std::string Encode(const live::PoseEvent& pose);
std::string Encode(const StateChange& change);
std::string Encode(const DecisionChange& change);
std::string Encode(const ScanInnovations& innovations);
std::string Encode(const HypothesesSample& sample);

/// Decodes an untrusted message. Errors: kInvalidArgument if the bytes are not such a message, or a
/// number in it is not finite.
Status Decode(std::string_view bytes, RecordedShift* shift);
Status Decode(std::string_view bytes, live::PoseEvent* pose);
Status Decode(std::string_view bytes, StateChange* change);
Status Decode(std::string_view bytes, DecisionChange* change);
Status Decode(std::string_view bytes, ScanInnovations* innovations);
Status Decode(std::string_view bytes, HypothesesSample* sample);

}  // namespace shiftmap
