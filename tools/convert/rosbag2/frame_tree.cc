// SPDX-License-Identifier: Apache-2.0
#include "tools/convert/rosbag2/frame_tree.h"

#include <algorithm>
#include <cmath>
#include <deque>

#include "mapstore/core/magnitude.h"

namespace shiftmap::rosbag2 {
namespace {

// A driver that writes a rotation of another length wrote no rotation.
constexpr double kMaxLengthError = 0.1;

StatusOr<Eigen::Vector3d> ReadVector(const MessageValue& message, const std::string& path) {
  Eigen::Vector3d vector;
  int i = 0;
  for (const char* name : {".x", ".y", ".z"}) {
    SHIFTMAP_ASSIGN_OR_RETURN(vector(i++), message.Number(path + name));
  }
  if (!(vector.cwiseAbs().maxCoeff() <= kMaxMagnitude)) {
    return InvalidArgument("field '{}': ({}, {}, {}), expected finite numbers",
                           path,
                           vector.x(),
                           vector.y(),
                           vector.z());
  }
  return vector;
}

}  // namespace

std::string FrameName(std::string name) {
  name.erase(0, std::min(name.find_first_not_of('/'), name.size()));
  return name;
}

StatusOr<Eigen::Isometry3d> ReadIsometry(const MessageValue& message,
                                         const std::string& position_path,
                                         const std::string& rotation_path) {
  SHIFTMAP_ASSIGN_OR_RETURN(const Eigen::Vector3d position, ReadVector(message, position_path));
  SHIFTMAP_ASSIGN_OR_RETURN(const Eigen::Vector3d imaginary, ReadVector(message, rotation_path));
  SHIFTMAP_ASSIGN_OR_RETURN(const double real, message.Number(rotation_path + ".w"));
  const Eigen::Quaterniond rotation(real, imaginary.x(), imaginary.y(), imaginary.z());
  if (!(std::abs(rotation.norm() - 1.0) <= kMaxLengthError)) {
    return InvalidArgument(
        "field '{}': length {}, expected a rotation of length 1", rotation_path, rotation.norm());
  }
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = rotation.normalized().toRotationMatrix();
  T.translation() = position;
  return T;
}

StatusOr<std::vector<FrameTransform>> ReadTransforms(const MessageValue& message) {
  SHIFTMAP_ASSIGN_OR_RETURN(const auto* list, message.List("transforms"));
  std::vector<FrameTransform> transforms;
  for (const MessageValue& value : *list) {
    FrameTransform& transform = transforms.emplace_back();
    SHIFTMAP_ASSIGN_OR_RETURN(transform.stamp, value.Time("header.stamp"));
    SHIFTMAP_ASSIGN_OR_RETURN(transform.parent, value.Text("header.frame_id"));
    SHIFTMAP_ASSIGN_OR_RETURN(transform.child, value.Text("child_frame_id"));
    transform.parent = FrameName(std::move(transform.parent));
    transform.child = FrameName(std::move(transform.child));
    SHIFTMAP_ASSIGN_OR_RETURN(transform.T_parent_child,
                              ReadIsometry(value, "transform.translation", "transform.rotation"));
  }
  return transforms;
}

void FrameTree::Add(const FrameTransform& transform) { by_child_[transform.child] = transform; }

StatusOr<Eigen::Isometry3d> FrameTree::Lookup(const std::string& target,
                                              const std::string& source) const {
  // Breadth first from the target: T_target_<frame>.
  std::multimap<std::string, const FrameTransform*> by_parent;
  for (const auto& [child, transform] : by_child_) by_parent.emplace(transform.parent, &transform);
  std::map<std::string, Eigen::Isometry3d> known = {{target, Eigen::Isometry3d::Identity()}};
  std::deque<std::string> open = {target};
  while (!open.empty()) {
    const std::string frame = open.front();
    open.pop_front();
    const Eigen::Isometry3d T_target_frame = known.at(frame);
    if (frame == source) return T_target_frame;
    const auto reach = [&](const std::string& next, const Eigen::Isometry3d& T_frame_next) {
      if (known.emplace(next, T_target_frame * T_frame_next).second) open.push_back(next);
    };
    if (const auto up = by_child_.find(frame); up != by_child_.end()) {
      reach(up->second.parent, up->second.T_parent_child.inverse());
    }
    const auto [first, last] = by_parent.equal_range(frame);
    for (auto down = first; down != last; ++down) {
      reach(down->second->child, down->second->T_parent_child);
    }
  }
  constexpr std::size_t kMaxShown = 200;
  std::string names;
  for (const auto& [name, T] : known) {
    if (names.size() > kMaxShown) break;
    names += (names.empty() ? "'" : ", '") + name.substr(0, kMaxShown) + "'";
  }
  return NotFound("no fixed transforms lead from frame '{}' to '{}', only to {}",
                  target.substr(0, kMaxShown),
                  source.substr(0, kMaxShown),
                  names);
}

}  // namespace shiftmap::rosbag2
