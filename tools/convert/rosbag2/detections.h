// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "mapstore/core/ids.h"
#include "mapstore/core/stamp.h"
#include "proto/core/status.h"
#include "tools/convert/rosbag2/frame_tree.h"
#include "tools/convert/rosbag2/message_value.h"

namespace shiftmap::rosbag2 {

inline constexpr std::string_view kDetection3dArray = "vision_msgs/Detection3DArray";
inline constexpr std::string_view kFiducialTransformArray = "fiducial_msgs/FiducialTransformArray";
inline constexpr std::string_view kAprilTagDetectionArray = "apriltag_msgs/AprilTagDetectionArray";

/// One landmark as a detector saw it.
struct Detection {
  Signature signature;
  std::string frame;      ///< That the position is in, e.g. of the camera.
  std::string tag_frame;  ///< Of an AprilTag: the frame on /tf that has its position.
  Eigen::Vector3d p_frame_landmark = Eigen::Vector3d::Zero();  ///< [m]
  std::optional<Eigen::Matrix3d> cov_p;                        ///< Of it, if stated. [m²]
};

struct DetectionScan {
  Stamp stamp;
  std::vector<Detection> detections;
};

struct DetectionOptions {
  /// Text with `{class_id}`, `{id}` or `{family}` in it, which fields of the detection replace.
  /// Empty: `{class_id}` of a Detection3DArray, `{id}` of fiducials, `{family}:{id}` of AprilTags.
  std::string signature;

  /// The frame on /tf of an AprilTag, in the same form.
  std::string tag_frame = "{family}:{id}";

  /// Take a Detection3D's position from its bounding box instead of its likeliest hypothesis.
  bool position_from_box = false;
};

/// Whether messages of a type are detections, by its short name.
bool IsDetectionType(const std::string& type);

/// Reads a message of one of the types above. The stamp is the header's. Detections of a
/// Detection3DArray without a hypothesis are left out, unless the box has the position and the
/// signature needs no class.
/// Errors: kInvalidArgument for a field that is not there, or a placeholder that this type does not
/// have.
StatusOr<DetectionScan> ReadDetections(const std::string& type,
                                       const MessageValue& message,
                                       const DetectionOptions& options);

}  // namespace shiftmap::rosbag2
