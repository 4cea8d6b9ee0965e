// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/pose_relations.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "tools/convert/decimal.h"
#include "tools/convert/text_table.h"

namespace shiftmap {
namespace {

constexpr double kInPlane = 1e-6;

StatusOr<PoseRelation> ToRelation(const TextRow& row) {
  PoseRelation relation;
  SHIFTMAP_ASSIGN_OR_RETURN(relation.a, ParseStamp(row[0]));
  SHIFTMAP_ASSIGN_OR_RETURN(relation.b, ParseStamp(row[1]));
  std::array<double, 6> numbers{};
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    SHIFTMAP_ASSIGN_OR_RETURN(numbers[i], ParseNumber(row[i + 2]));
  }
  for (const std::size_t out_of_plane : {2U, 3U, 4U}) {
    if (std::abs(numbers[out_of_plane]) > kInPlane) {
      return InvalidArgument("z, roll or pitch is {}, expected 0", numbers[out_of_plane]);
    }
  }
  relation.T_a_b = Se2(numbers[0], numbers[1], numbers[5]);
  return relation;
}

const StampedPose* PoseAt(std::span<const StampedPose> trajectory, Stamp stamp) {
  constexpr Duration kSame = std::chrono::microseconds(1);
  const auto pose = std::lower_bound(
      trajectory.begin(), trajectory.end(), stamp - kSame, [](const StampedPose& p, Stamp at) {
        return p.stamp < at;
      });
  return pose != trajectory.end() && pose->stamp <= stamp + kSame ? &*pose : nullptr;
}

// Mean, standard deviation and mean square.
std::array<double, 3> Summary(const std::vector<double>& values) {
  double sum = 0.0;
  double squares = 0.0;
  for (const double value : values) {
    sum += value;
    squares += value * value;
  }
  const auto n = static_cast<double>(values.size());
  const double mean = sum / n;
  return {mean, std::sqrt(std::max(0.0, squares / n - mean * mean)), squares / n};
}

}  // namespace

StatusOr<std::vector<PoseRelation>> ReadPoseRelations(const std::string& path) {
  std::vector<PoseRelation> relations;
  SHIFTMAP_RETURN_IF_ERROR(ForEachRow(path, 8, [&](const TextRow& row) -> Status {
    SHIFTMAP_ASSIGN_OR_RETURN(const PoseRelation relation, ToRelation(row));
    relations.push_back(relation);
    return OkStatus();
  }));
  return relations;
}

std::vector<PoseRelation> RelationsAlong(std::span<const StampedPose> trajectory, std::size_t lag) {
  std::vector<PoseRelation> relations;
  for (std::size_t i = lag; i < trajectory.size(); ++i) {
    const StampedPose& a = trajectory[i - lag];
    const StampedPose& b = trajectory[i];
    relations.push_back({a.stamp, b.stamp, a.T_map_vehicle.Inverse() * b.T_map_vehicle});
  }
  return relations;
}

StatusOr<RelationError> EvaluateRelations(std::span<const StampedPose> trajectory,
                                          std::span<const PoseRelation> relations) {
  std::vector<double> translations;
  std::vector<double> rotations;
  for (const PoseRelation& relation : relations) {
    const StampedPose* a = PoseAt(trajectory, relation.a);
    const StampedPose* b = PoseAt(trajectory, relation.b);
    if (a == nullptr || b == nullptr) continue;
    const Se2 error = relation.T_a_b.Inverse() * (a->T_map_vehicle.Inverse() * b->T_map_vehicle);
    translations.push_back(error.translation().norm());
    rotations.push_back(std::abs(error.yaw()));
  }
  if (translations.empty()) {
    return InvalidArgument(
        "none of {} relations is between two of {} poses", relations.size(), trajectory.size());
  }
  const auto [translation, translation_sd, translation_square] = Summary(translations);
  const auto [rotation, rotation_sd, rotation_square] = Summary(rotations);
  return RelationError{static_cast<int>(translations.size()),
                       translation,
                       translation_sd,
                       translation_square,
                       rotation,
                       rotation_sd,
                       rotation_square};
}

}  // namespace shiftmap
