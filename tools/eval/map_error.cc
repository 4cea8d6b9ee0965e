// SPDX-License-Identifier: Apache-2.0
#include "tools/eval/map_error.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>
#include <unordered_map>

#include "mapstore/core/quantile.h"
#include "mapstore/run/trajectory.h"
#include "tools/eval/trajectory_error.h"

namespace shiftmap {
namespace {

// Places and modes that an alignment brings closer than this agree.
constexpr double kInlier_m = 1.0;

// Two places far apart fix the rotation well; hypotheses beyond this number add nothing.
constexpr std::size_t kMaxHypotheses = 4000;

constexpr int kRefinements = 10;

// A true place with the modes of its landmark.
struct Candidate {
  Eigen::Vector2d p_truth;
  std::span<const Mode> modes;
};

struct Nearest {
  const Mode* mode = nullptr;
  double distance_m = std::numeric_limits<double>::infinity();
};

Nearest FindNearest(const Candidate& candidate, const Se2& T_truth_map) {
  Nearest nearest;
  for (const Mode& mode : candidate.modes) {
    const double distance = (T_truth_map * mode.p_map_landmark - candidate.p_truth).norm();
    if (distance < nearest.distance_m) nearest = {&mode, distance};
  }
  return nearest;
}

// Smaller is better; a place that does not agree costs as much as one that barely does.
double Cost(std::span<const Candidate> candidates, const Se2& T_truth_map) {
  double cost = 0.0;
  for (const Candidate& candidate : candidates) {
    const double distance = std::min(kInlier_m, FindNearest(candidate, T_truth_map).distance_m);
    cost += distance * distance;
  }
  return cost;
}

std::optional<Se2> Refine(std::span<const Candidate> candidates, const Se2& start) {
  Se2 T_truth_map = start;
  for (int i = 0; i < kRefinements; ++i) {
    std::vector<PointPair> pairs;
    for (const Candidate& candidate : candidates) {
      const Nearest nearest = FindNearest(candidate, T_truth_map);
      if (nearest.distance_m < kInlier_m) {
        pairs.push_back({candidate.p_truth, nearest.mode->p_map_landmark});
      }
    }
    const StatusOr<Se2> aligned = AlignRigid2d(pairs);
    if (!aligned.ok()) return std::nullopt;
    T_truth_map = *aligned;
  }
  return T_truth_map;
}

// Calls `visit` with each transform that brings two places onto modes of theirs.
template <typename Visit>
void ForEachHypothesis(std::span<const Candidate> candidates, const Visit& visit) {
  const std::size_t pairs = candidates.size() * (candidates.size() - 1) / 2;
  const std::size_t stride = std::max<std::size_t>(1, pairs / kMaxHypotheses);
  std::size_t pair = 0;
  for (std::size_t i = 0; i < candidates.size(); ++i) {
    for (std::size_t j = i + 1; j < candidates.size(); ++j, ++pair) {
      if (pair % stride != 0) continue;
      const double distance = (candidates[i].p_truth - candidates[j].p_truth).norm();
      for (const Mode& mode_i : candidates[i].modes) {
        for (const Mode& mode_j : candidates[j].modes) {
          const double mapped = (mode_i.p_map_landmark - mode_j.p_map_landmark).norm();
          if (distance < kInlier_m || std::abs(mapped - distance) > kInlier_m) continue;
          const PointPair ends[] = {{candidates[i].p_truth, mode_i.p_map_landmark},
                                    {candidates[j].p_truth, mode_j.p_map_landmark}};
          const StatusOr<Se2> aligned = AlignRigid2d(ends);
          if (aligned.ok()) visit(*aligned);
        }
      }
    }
  }
}

StatusOr<Se2> Align(std::span<const Candidate> candidates) {
  double least = std::numeric_limits<double>::infinity();
  std::optional<Se2> best;
  ForEachHypothesis(candidates, [&](const Se2& T_truth_map) {
    const double cost = Cost(candidates, T_truth_map);
    if (cost >= least) return;
    least = cost;
    best = T_truth_map;
  });
  if (best) best = Refine(candidates, *best);
  if (!best) {
    return InvalidArgument("map: no rigid transform brings two of {} places onto the map",
                           candidates.size());
  }
  return *best;
}

}  // namespace

StatusOr<MapError> EvaluateMap(std::span<const LandmarkGroup> groups,
                               std::span<const TruePlace> truth,
                               bool align) {
  std::unordered_map<Signature, const LandmarkGroup*> by_signature;
  for (const LandmarkGroup& group : groups) by_signature[group.signature] = &group;
  MapError result;
  std::vector<Candidate> candidates;
  std::vector<Signature> signatures;
  for (const TruePlace& place : truth) {
    const auto found = by_signature.find(place.signature);
    if (found == by_signature.end() || found->second->modes.empty()) {
      result.unmatched.push_back(place.signature);
      continue;
    }
    candidates.push_back({place.p_truth, found->second->modes});
    signatures.push_back(place.signature);
  }
  if (candidates.empty()) {
    return InvalidArgument("map: none of {} true places is of a landmark of the map", truth.size());
  }
  if (align) {
    SHIFTMAP_ASSIGN_OR_RETURN(result.T_truth_map, Align(candidates));
  }
  std::vector<double> distances;
  for (std::size_t i = 0; i < candidates.size(); ++i) {
    const Nearest nearest = FindNearest(candidates[i], result.T_truth_map);
    result.matches.push_back({signatures[i], nearest.mode->number, nearest.distance_m});
    distances.push_back(nearest.distance_m);
  }
  const double sum2 =
      std::inner_product(distances.begin(), distances.end(), distances.begin(), 0.0);
  result.rmse_m = std::sqrt(sum2 / static_cast<double>(distances.size()));
  result.median_m = Quantile(distances, 0.5);
  result.max_m = Quantile(distances, 1.0);
  return result;
}

}  // namespace shiftmap
