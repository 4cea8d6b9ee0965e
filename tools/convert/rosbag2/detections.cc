// SPDX-License-Identifier: Apache-2.0
#include "tools/convert/rosbag2/detections.h"

#include <limits>
#include <utility>

namespace shiftmap::rosbag2 {
namespace {

using Words = std::map<std::string, std::string, std::less<>>;

// Puts a detection's words in for the placeholders of a text.
StatusOr<std::string> Fill(std::string_view form, const Words& words) {
  std::string text;
  while (!form.empty()) {
    const std::size_t open = form.find('{');
    text += form.substr(0, open);
    if (open == std::string_view::npos) break;
    const std::size_t close = form.find('}', open);
    const auto word = close == std::string_view::npos
                          ? words.end()
                          : words.find(form.substr(open + 1, close - open - 1));
    if (word == words.end()) {
      std::string names;
      for (const auto& [name, value] : words) names += " {" + name + "}";
      return InvalidArgument("'{}': these detections have{}", form, names);
    }
    text += word->second;
    form.remove_prefix(close + 1);
  }
  return text;
}

std::string OrElse(const std::string& text, const char* other) {
  return text.empty() ? other : text;
}

// The block of the position in a covariance over position and rotation; nothing if none is stated.
std::optional<Eigen::Matrix3d> PositionCovariance(const std::vector<double>& numbers) {
  constexpr std::size_t kSize = 6;
  if (numbers.size() != kSize * kSize) return std::nullopt;
  Eigen::Matrix3d cov;
  for (Eigen::Index row = 0; row < 3; ++row) {
    for (Eigen::Index column = 0; column < 3; ++column) {
      cov(row, column) =
          numbers[static_cast<std::size_t>(row) * kSize + static_cast<std::size_t>(column)];
    }
  }
  if (!cov.allFinite() || cov.diagonal().minCoeff() < 0.0 || cov.trace() <= 0.0) {
    return std::nullopt;
  }
  return Eigen::Matrix3d(0.5 * (cov + cov.transpose()));
}

StatusOr<const MessageValue*> LikeliestResult(const std::vector<MessageValue>& results) {
  const MessageValue* best = nullptr;
  double best_score = -std::numeric_limits<double>::infinity();
  for (const MessageValue& result : results) {
    // Before vision_msgs 3 the hypothesis was not a message of its own.
    const bool nested = result.Find("hypothesis") != nullptr;
    SHIFTMAP_ASSIGN_OR_RETURN(const double score,
                              result.Number(nested ? "hypothesis.score" : "score"));
    if (best != nullptr && !(score > best_score)) continue;
    best = &result;
    best_score = score;
  }
  return best;
}

StatusOr<std::string> ClassOf(const MessageValue& result) {
  for (const char* path : {"hypothesis.class_id", "class_id", "id"}) {
    if (result.Find(path) != nullptr) return result.Text(path);
  }
  return InvalidArgument("a result has no field hypothesis.class_id");
}

// Nothing if the detection has no hypothesis where one is needed.
StatusOr<std::optional<Detection>> ReadDetection3d(const MessageValue& value,
                                                   const DetectionOptions& options) {
  SHIFTMAP_ASSIGN_OR_RETURN(const auto* results, value.List("results"));
  SHIFTMAP_ASSIGN_OR_RETURN(const MessageValue* best, LikeliestResult(*results));
  const std::string form = OrElse(options.signature, "{class_id}");
  const bool needs_class = form.find("{class_id}") != std::string::npos;
  if (best == nullptr && (needs_class || !options.position_from_box)) return std::nullopt;
  Words words = {{"class_id", ""}};
  if (best != nullptr) {
    SHIFTMAP_ASSIGN_OR_RETURN(words["class_id"], ClassOf(*best));
  }
  if (value.Find("id") != nullptr) {
    SHIFTMAP_ASSIGN_OR_RETURN(words["id"], value.Text("id"));
  }
  Detection detection;
  SHIFTMAP_ASSIGN_OR_RETURN(const std::string signature, Fill(form, words));
  detection.signature = Signature(signature);
  SHIFTMAP_ASSIGN_OR_RETURN(detection.frame, value.Text("header.frame_id"));
  const MessageValue& from = options.position_from_box ? value : *best;
  const std::string path =
      options.position_from_box ? "bbox.center.position" : "pose.pose.position";
  int i = 0;
  for (const char* name : {".x", ".y", ".z"}) {
    SHIFTMAP_ASSIGN_OR_RETURN(detection.p_frame_landmark(i++), from.Number(path + name));
  }
  if (best != nullptr) {
    SHIFTMAP_ASSIGN_OR_RETURN(const auto* covariance, best->Numbers("pose.covariance"));
    detection.cov_p = PositionCovariance(*covariance);
  }
  return detection;
}

StatusOr<std::optional<Detection>> ReadFiducial(const MessageValue& value,
                                                const DetectionOptions& options) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::int64_t id, value.Integer("fiducial_id"));
  Detection detection;
  SHIFTMAP_ASSIGN_OR_RETURN(const std::string signature,
                            Fill(OrElse(options.signature, "{id}"), {{"id", std::to_string(id)}}));
  detection.signature = Signature(signature);
  SHIFTMAP_ASSIGN_OR_RETURN(const Eigen::Isometry3d T,
                            ReadIsometry(value, "transform.translation", "transform.rotation"));
  detection.p_frame_landmark = T.translation();
  return detection;
}

StatusOr<std::optional<Detection>> ReadAprilTag(const MessageValue& value,
                                                const DetectionOptions& options) {
  Words words;
  SHIFTMAP_ASSIGN_OR_RETURN(words["family"], value.Text("family"));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::int64_t id, value.Integer("id"));
  words["id"] = std::to_string(id);
  Detection detection;
  SHIFTMAP_ASSIGN_OR_RETURN(const std::string signature,
                            Fill(OrElse(options.signature, "{family}:{id}"), words));
  detection.signature = Signature(signature);
  SHIFTMAP_ASSIGN_OR_RETURN(detection.tag_frame, Fill(options.tag_frame, words));
  return detection;
}

}  // namespace

bool IsDetectionType(const std::string& type) {
  return type == kDetection3dArray || type == kFiducialTransformArray ||
         type == kAprilTagDetectionArray;
}

StatusOr<DetectionScan> ReadDetections(const std::string& type,
                                       const MessageValue& message,
                                       const DetectionOptions& options) {
  DetectionScan scan;
  SHIFTMAP_ASSIGN_OR_RETURN(scan.stamp, message.Time("header.stamp"));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::string frame, message.Text("header.frame_id"));
  const auto read = type == kDetection3dArray         ? &ReadDetection3d
                    : type == kFiducialTransformArray ? &ReadFiducial
                                                      : &ReadAprilTag;
  SHIFTMAP_ASSIGN_OR_RETURN(
      const auto* list,
      message.List(type == kFiducialTransformArray ? "transforms" : "detections"));
  for (const MessageValue& value : *list) {
    SHIFTMAP_ASSIGN_OR_RETURN(std::optional<Detection> detection, read(value, options));
    if (!detection) continue;
    if (detection->frame.empty()) detection->frame = frame;
    detection->frame = FrameName(std::move(detection->frame));
    scan.detections.push_back(*std::move(detection));
  }
  return scan;
}

}  // namespace shiftmap::rosbag2
