// SPDX-License-Identifier: Apache-2.0
#include "localizer/recording/codec/scene_codec.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <cstdint>

#include "mapstore/core/inert_text.h"
#include "mapstore/core/mode_name.h"
#include "proto/foxglove.pb.h"

namespace shiftmap {
namespace {

constexpr const char* kMapFrame = "map";
constexpr const char* kVehicleFrame = "vehicle";

constexpr double kSphereM = 0.3;  // Of a mode: seen at the scale of a site.
constexpr double kEllipseHeightM = 0.02;
constexpr double kArrowLengthM = 1.0;
constexpr double kLineWidthPixels = 1.5;
constexpr double kFontPixels = 14.0;

struct Rgb {
  double r, g, b;
};
constexpr Rgb kModeColor{0.12, 0.47, 0.71};
constexpr Rgb kAnonymousColor{0.5, 0.5, 0.5};
constexpr Rgb kLeafColor{0.89, 0.42, 0.04};

google::protobuf::Timestamp Timestamp(Stamp stamp) {
  constexpr std::int64_t kNanoseconds = 1'000'000'000;
  const std::int64_t ns = std::max<std::int64_t>(ToNanoseconds(stamp), 0);
  google::protobuf::Timestamp timestamp;
  timestamp.set_seconds(ns / kNanoseconds);
  timestamp.set_nanos(static_cast<std::int32_t>(ns % kNanoseconds));
  return timestamp;
}

void Set(double x, double y, double z, foxglove::Vector3* out) {
  out->set_x(x);
  out->set_y(y);
  out->set_z(z);
}

void Set(double yaw, foxglove::Quaternion* out) {
  out->set_z(std::sin(0.5 * yaw));
  out->set_w(std::cos(0.5 * yaw));
}

void Set(const Se2& T, foxglove::Pose* out) {
  Set(T.x(), T.y(), 0.0, out->mutable_position());
  Set(T.yaw(), out->mutable_orientation());
}

void Set(const Rgb& color, double opacity, foxglove::Color* out) {
  out->set_r(color.r);
  out->set_g(color.g);
  out->set_b(color.b);
  out->set_a(std::clamp(opacity, 0.0, 1.0));
}

foxglove::SceneEntity* AddEntity(Stamp stamp, const std::string& id, foxglove::SceneUpdate* scene) {
  foxglove::SceneEntity* entity = scene->add_entities();
  *entity->mutable_timestamp() = Timestamp(stamp);
  entity->set_frame_id(kMapFrame);
  entity->set_id(id);
  return entity;
}

void AddSphere(const Eigen::Vector2d& p,
               const Rgb& color,
               double opacity,
               foxglove::SceneEntity* entity) {
  foxglove::SpherePrimitive* sphere = entity->add_spheres();
  Set(Se2(p.x(), p.y(), 0.0), sphere->mutable_pose());
  Set(kSphereM, kSphereM, kSphereM, sphere->mutable_size());
  Set(color, opacity, sphere->mutable_color());
}

// The 95 % ellipse of a position, flat on the floor.
void AddEllipse(const Eigen::Vector2d& p,
                const Eigen::Matrix2d& cov,
                const Rgb& color,
                double opacity,
                foxglove::SceneEntity* entity) {
  static const double kSigmas = std::sqrt(ChiSquareQuantile(0.95, 2));
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> axes(cov);
  const Eigen::Vector2d diameters = 2.0 * kSigmas * axes.eigenvalues().cwiseMax(0.0).cwiseSqrt();
  const Eigen::Vector2d first = axes.eigenvectors().col(0);
  foxglove::SpherePrimitive* ellipse = entity->add_spheres();
  Set(Se2(p.x(), p.y(), std::atan2(first.y(), first.x())), ellipse->mutable_pose());
  Set(diameters.x(), diameters.y(), kEllipseHeightM, ellipse->mutable_size());
  Set(color, opacity, ellipse->mutable_color());
}

void AddLabel(const Eigen::Vector2d& p, const std::string& text, foxglove::SceneEntity* entity) {
  foxglove::TextPrimitive* label = entity->add_texts();
  Set(Se2(p.x(), p.y(), 0.0), label->mutable_pose());
  label->mutable_pose()->mutable_position()->set_z(kSphereM);
  label->set_billboard(true);
  label->set_scale_invariant(true);
  label->set_font_size(kFontPixels);
  Set(kModeColor, 1.0, label->mutable_color());
  label->set_text(text);
}

void AddLines(const LandmarkGroup& group, foxglove::SceneEntity* entity) {
  if (group.modes.size() < 2) return;
  foxglove::LinePrimitive* line = entity->add_lines();
  line->set_thickness(kLineWidthPixels);
  line->set_scale_invariant(true);
  Set(Se2(), line->mutable_pose());
  Set(kModeColor, 0.5, line->mutable_color());
  for (const Mode& mode : group.modes) {
    foxglove::Point3* point = line->add_points();
    point->set_x(mode.p_map_landmark.x());
    point->set_y(mode.p_map_landmark.y());
  }
}

void AddProbability(ModeNumber mode, double probability, foxglove::SceneEntity* entity) {
  foxglove::KeyValuePair* pair = entity->add_metadata();
  pair->set_key(ModeName(mode));
  pair->set_value(fmt::format("{:.4f}", probability));
}

void AddGroup(Stamp stamp, const DrawnGroup& drawn, foxglove::SceneUpdate* scene) {
  const LandmarkGroup& group = *drawn.group;
  const std::string name = InertLine(group.signature.text());
  foxglove::SceneEntity* entity = AddEntity(stamp, "landmark " + name, scene);
  AddProbability(kAbsent, (*drawn.probabilities)(0), entity);
  for (std::size_t i = 0; i < group.modes.size(); ++i) {
    const Mode& mode = group.modes[i];
    const double probability = (*drawn.probabilities)(static_cast<Eigen::Index>(i + 1));
    AddSphere(mode.p_map_landmark, kModeColor, probability, entity);
    AddEllipse(mode.p_map_landmark, mode.cov_p_map_landmark, kModeColor, probability, entity);
    AddLabel(mode.p_map_landmark, fmt::format("{}/{}", name, mode.number.value()), entity);
    AddProbability(mode.number, probability, entity);
  }
  AddLines(group, entity);
}

}  // namespace

std::string EncodePoseInFrame(Stamp stamp, const Se2& T_map_vehicle) {
  foxglove::PoseInFrame out;
  *out.mutable_timestamp() = Timestamp(stamp);
  out.set_frame_id(kMapFrame);
  Set(T_map_vehicle, out.mutable_pose());
  return out.SerializeAsString();
}

std::string EncodeFrameTransform(Stamp stamp, const Se2& T_map_vehicle) {
  foxglove::FrameTransform out;
  *out.mutable_timestamp() = Timestamp(stamp);
  out.set_parent_frame_id(kMapFrame);
  out.set_child_frame_id(kVehicleFrame);
  Set(T_map_vehicle.x(), T_map_vehicle.y(), 0.0, out.mutable_translation());
  Set(T_map_vehicle.yaw(), out.mutable_rotation());
  return out.SerializeAsString();
}

std::string EncodePosesInFrame(Stamp stamp, std::span<const Se2> poses) {
  foxglove::PosesInFrame out;
  *out.mutable_timestamp() = Timestamp(stamp);
  out.set_frame_id(kMapFrame);
  for (const Se2& pose : poses) Set(pose, out.add_poses());
  return out.SerializeAsString();
}

std::string EncodeLog(Stamp stamp, LogLevel level, const std::string& text) {
  foxglove::Log out;
  *out.mutable_timestamp() = Timestamp(stamp);
  out.set_level(level == LogLevel::kInfo      ? foxglove::Log::INFO
                : level == LogLevel::kWarning ? foxglove::Log::WARNING
                                              : foxglove::Log::ERROR);
  out.set_message(InertLine(text));
  out.set_name("shiftmap-localizer");
  return out.SerializeAsString();
}

std::string EncodeMapScene(Stamp stamp,
                           std::span<const DrawnGroup> groups,
                           std::span<const Mode> anonymous_landmarks) {
  foxglove::SceneUpdate scene;
  for (const DrawnGroup& group : groups) AddGroup(stamp, group, &scene);
  if (!anonymous_landmarks.empty()) {
    foxglove::SceneEntity* entity = AddEntity(stamp, "anonymous landmarks", &scene);
    for (const Mode& landmark : anonymous_landmarks) {
      AddSphere(landmark.p_map_landmark, kAnonymousColor, 1.0, entity);
    }
  }
  return scene.SerializeAsString();
}

std::string EncodeLeafScene(Stamp stamp,
                            std::span<const std::pair<double, Se2>> leaves,
                            const PoseWithCovariance& estimate) {
  foxglove::SceneUpdate scene;
  foxglove::SceneEntity* entity = AddEntity(stamp, "hypotheses", &scene);
  for (const auto& [weight, T_map_vehicle] : leaves) {
    foxglove::ArrowPrimitive* arrow = entity->add_arrows();
    Set(T_map_vehicle, arrow->mutable_pose());
    arrow->set_shaft_length(0.7 * kArrowLengthM);
    arrow->set_shaft_diameter(0.1 * kArrowLengthM);
    arrow->set_head_length(0.3 * kArrowLengthM);
    arrow->set_head_diameter(0.25 * kArrowLengthM);
    Set(kLeafColor, weight, arrow->mutable_color());
  }
  const Eigen::Matrix2d R = estimate.T_map_vehicle.Rotation();
  const Eigen::Matrix2d cov = estimate.cov_T_map_vehicle.topLeftCorner<2, 2>();
  AddEllipse(
      estimate.T_map_vehicle.translation(), R * cov * R.transpose(), kLeafColor, 0.3, entity);
  return scene.SerializeAsString();
}

}  // namespace shiftmap
