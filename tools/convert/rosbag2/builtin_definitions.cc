// SPDX-License-Identifier: Apache-2.0
#include "tools/convert/rosbag2/builtin_definitions.h"

#include <map>

#include "tools/convert/rosbag2/message_definition.h"

namespace shiftmap::rosbag2 {
namespace {

const std::map<std::string_view, std::string_view>& Texts() {
  static const std::map<std::string_view, std::string_view> texts = {
      {"std_msgs/Header", "builtin_interfaces/Time stamp\nstring frame_id\n"},
      {"geometry_msgs/Point", "float64 x\nfloat64 y\nfloat64 z\n"},
      {"geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z\n"},
      {"geometry_msgs/Quaternion", "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n"},
      {"geometry_msgs/Pose", "Point position\nQuaternion orientation\n"},
      {"geometry_msgs/PoseWithCovariance", "Pose pose\nfloat64[36] covariance\n"},
      {"geometry_msgs/Twist", "Vector3 linear\nVector3 angular\n"},
      {"geometry_msgs/TwistWithCovariance", "Twist twist\nfloat64[36] covariance\n"},
      {"geometry_msgs/TwistStamped", "std_msgs/Header header\nTwist twist\n"},
      {"geometry_msgs/Transform", "Vector3 translation\nQuaternion rotation\n"},
      {"geometry_msgs/TransformStamped",
       "std_msgs/Header header\nstring child_frame_id\nTransform transform\n"},
      {"nav_msgs/Odometry",
       "std_msgs/Header header\nstring child_frame_id\n"
       "geometry_msgs/PoseWithCovariance pose\ngeometry_msgs/TwistWithCovariance twist\n"},
      {"tf2_msgs/TFMessage", "geometry_msgs/TransformStamped[] transforms\n"},
      {"vision_msgs/ObjectHypothesis", "string class_id\nfloat64 score\n"},
      {"vision_msgs/ObjectHypothesisWithPose",
       "ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose\n"},
      {"vision_msgs/BoundingBox3D", "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size\n"},
      {"vision_msgs/Detection3D",
       "std_msgs/Header header\nObjectHypothesisWithPose[] results\nBoundingBox3D bbox\n"
       "string id\n"},
      {"vision_msgs/Detection3DArray", "std_msgs/Header header\nDetection3D[] detections\n"},
      {"fiducial_msgs/FiducialTransform",
       "int32 fiducial_id\ngeometry_msgs/Transform transform\nfloat64 image_error\n"
       "float64 object_error\nfloat64 fiducial_area\n"},
      {"fiducial_msgs/FiducialTransformArray",
       "std_msgs/Header header\nint32 image_seq\nFiducialTransform[] transforms\n"},
      {"apriltag_msgs/Point", "float64 x\nfloat64 y\n"},
      {"apriltag_msgs/AprilTagDetection",
       "string family\nint32 id\nint32 hamming\nfloat32 goodness\nfloat32 decision_margin\n"
       "Point centre\nPoint[4] corners\nfloat64[9] homography\n"},
      {"apriltag_msgs/AprilTagDetectionArray",
       "std_msgs/Header header\nAprilTagDetection[] detections\n"},
  };
  return texts;
}

}  // namespace

std::string BuiltinDefinition(std::string_view type) {
  const auto root = Texts().find(ShortTypeName(type));
  if (root == Texts().end()) return "";
  std::string text(root->second);
  for (const auto& [name, fields] : Texts()) {
    if (name == root->first) continue;
    text += "===\nMSG: " + std::string(name) + "\n" + std::string(fields);
  }
  return text;
}

}  // namespace shiftmap::rosbag2
