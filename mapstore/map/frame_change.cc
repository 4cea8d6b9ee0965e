// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/frame_change.h"

#include <algorithm>
#include <span>
#include <utility>

#include "mapstore/core/quantile.h"
#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

constexpr int kSteps = 20;
constexpr double kSamePlace = 1e-6;  // [m]

struct ModePair {
  Mode* from = nullptr;
  const Mode* to = nullptr;
};

// The modes that both maps have; groups are by signature, modes by number.
std::vector<ModePair> CommonModes(MapContent* from, const MapContent& to) {
  std::vector<ModePair> pairs;
  auto other = to.groups.begin();
  for (LandmarkGroup& group : from->groups) {
    while (other != to.groups.end() && other->signature < group.signature) ++other;
    if (other == to.groups.end() || other->signature != group.signature) continue;
    for (Mode& mode : group.modes) {
      const int state = other->StateOf(mode.number);
      if (state < 1) continue;
      pairs.push_back({&mode, &other->modes[static_cast<std::size_t>(state) - 1]});
    }
  }
  return pairs;
}

void SortByDistance(const Se2& T_a_b, std::vector<PointPair>* pairs) {
  std::stable_sort(pairs->begin(), pairs->end(), [&](const PointPair& one, const PointPair& other) {
    return (T_a_b * one.p_b - one.p_a).squaredNorm() <
           (T_a_b * other.p_b - other.p_a).squaredNorm();
  });
}

Se2 Fit(const std::vector<ModePair>& pairs) {
  std::vector<PointPair> points;
  for (const ModePair& pair : pairs) {
    points.push_back({pair.to->p_map_landmark, pair.from->p_map_landmark});
  }
  // Each step takes the half that the last fit explains best, whose squares sum up to less.
  StatusOr<Se2> fit = AlignRigid2d(points);
  const std::size_t half = points.size() / 2 + 1;
  for (int i = 0; i < kSteps && fit.ok(); ++i) {
    SortByDistance(*fit, &points);
    fit = AlignRigid2d(std::span(points).first(std::min(half, points.size())));
  }
  if (!fit.ok()) return {};
  SortByDistance(*fit, &points);
  const PointPair& middle = points[points.size() / 2];
  const double bound = 3.0 * (*fit * middle.p_b - middle.p_a).norm() + kSamePlace;
  std::erase_if(points,
                [&](const PointPair& pair) { return (*fit * pair.p_b - pair.p_a).norm() > bound; });
  return AlignRigid2d(points).value_or(*fit);
}

std::size_t CountBeyond(const std::vector<ModePair>& pairs) {
  static const double kGate = ChiSquareQuantile(0.99, 2);
  return static_cast<std::size_t>(
      std::count_if(pairs.begin(), pairs.end(), [](const ModePair& pair) {
        return SquaredMahalanobis(pair.to->p_map_landmark - pair.from->p_map_landmark,
                                  pair.to->cov_p_map_landmark + pair.from->cov_p_map_landmark) >
               kGate;
      }));
}

double MedianDistance(const std::vector<ModePair>& pairs) {
  std::vector<double> distances;
  for (const ModePair& pair : pairs) {
    distances.push_back((pair.to->p_map_landmark - pair.from->p_map_landmark).norm());
  }
  return Quantile(std::move(distances), 0.5);
}

// Leaves the marginals of the modes.
void ForgetCorrelations(MapContent* content) {
  std::vector<Eigen::Matrix2d> diagonal;
  for (const LandmarkGroup& group : content->groups) {
    for (const Mode& mode : group.modes) diagonal.push_back(mode.cov_p_map_landmark);
  }
  content->covariance = JointCovariance(std::move(diagonal), {});
}

// Removes the rounding errors that the motion left.
void Settle(const std::vector<ModePair>& pairs, MapContent* from, const MapContent& to) {
  for (const ModePair& pair : pairs) {
    Mode& mode = *pair.from;
    if ((mode.p_map_landmark - pair.to->p_map_landmark).norm() > kSamePlace) continue;
    mode.p_map_landmark = pair.to->p_map_landmark;
    if (mode.cov_p_map_landmark.isApprox(pair.to->cov_p_map_landmark, 1e-6)) {
      mode.cov_p_map_landmark = pair.to->cov_p_map_landmark;
    }
  }
  std::vector<Mode>& anonymous = from->anonymous_landmarks;
  if (anonymous.size() != to.anonymous_landmarks.size()) return;
  for (std::size_t i = 0; i < anonymous.size(); ++i) {
    const Mode& other = to.anonymous_landmarks[i];
    const bool same = anonymous[i].number == other.number &&
                      (anonymous[i].p_map_landmark - other.p_map_landmark).norm() <= kSamePlace &&
                      anonymous[i].cov_p_map_landmark.isApprox(other.cov_p_map_landmark, 1e-6);
    if (same) anonymous[i] = other;
  }
}

}  // namespace

void MoveContent(const Se2& T_new_old, MapContent* content) {
  const Eigen::Matrix2d R = T_new_old.Rotation();
  const auto turn = [&](const Eigen::Matrix2d& cov) -> Eigen::Matrix2d {
    const Eigen::Matrix2d turned = R * cov * R.transpose();
    return 0.5 * (turned + turned.transpose());
  };
  const bool turns = T_new_old.yaw() != 0.0;
  std::vector<Eigen::Matrix2d> diagonal;
  for (LandmarkGroup& group : content->groups) {
    for (Mode& mode : group.modes) {
      mode.p_map_landmark = T_new_old * mode.p_map_landmark;
      if (turns) mode.cov_p_map_landmark = turn(mode.cov_p_map_landmark);
      diagonal.push_back(mode.cov_p_map_landmark);
    }
  }
  for (Mode& mode : content->anonymous_landmarks) {
    mode.p_map_landmark = T_new_old * mode.p_map_landmark;
    if (turns) mode.cov_p_map_landmark = turn(mode.cov_p_map_landmark);
  }
  if (!turns) return;
  std::vector<JointCovariance::CrossBlock> cross = content->covariance.cross_blocks();
  for (JointCovariance::CrossBlock& block : cross) block.value = R * block.value * R.transpose();
  content->covariance = JointCovariance(std::move(diagonal), std::move(cross));
}

void MoveTrajectory(const Se2& T_new_old, std::vector<StampedPose>* trajectory) {
  for (StampedPose& pose : *trajectory) pose.T_map_vehicle = T_new_old * pose.T_map_vehicle;
}

Se2 FitFrame(const MapContent& from, const MapContent& to) {
  MapContent copy;
  copy.groups = from.groups;
  return Fit(CommonModes(&copy, to));
}

MapContent WithNames(MapContent from,
                     const LandmarkNames& from_names,
                     const LandmarkNames& to_names) {
  for (LandmarkGroup& group : from.groups) {
    group.signature = to_names.Name(from_names.Landmark(group.signature));
  }
  std::sort(from.groups.begin(), from.groups.end(), [](const auto& a, const auto& b) {
    return a.signature < b.signature;
  });
  ForgetCorrelations(&from);
  return from;
}

CarriedMap CarryMap(const MapContent& from,
                    const LandmarkNames& from_names,
                    const MapContent& to,
                    const LandmarkNames& to_names) {
  CarriedMap carried;
  for (const LandmarkGroup& group : from.groups) {
    const Signature name = to_names.Name(from_names.Landmark(group.signature));
    if (name != group.signature) carried.renamed.emplace_back(group.signature, name);
  }
  MapContent& content = carried.content;
  content = WithNames(from, from_names, to_names);
  const std::vector<ModePair> pairs = CommonModes(&content, to);
  if (pairs.size() < 3 || 2 * CountBeyond(pairs) <= pairs.size()) return carried;
  const Se2 T_to_from = Fit(pairs);
  MapContent moved = content;
  MoveContent(T_to_from, &moved);
  const std::vector<ModePair> moved_pairs = CommonModes(&moved, to);
  if (2.0 * MedianDistance(moved_pairs) >= MedianDistance(pairs)) return carried;
  Settle(moved_pairs, &moved, to);
  ForgetCorrelations(&moved);
  content = std::move(moved);
  carried.moved = T_to_from;
  return carried;
}

}  // namespace shiftmap
