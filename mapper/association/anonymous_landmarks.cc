// SPDX-License-Identifier: Apache-2.0
#include "mapper/association/anonymous_landmarks.h"

#include <algorithm>
#include <tuple>

#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

struct LandmarkMatch {
  double squared_distance = 0.0;
  std::size_t found = 0;
  std::size_t known = 0;
};

std::vector<LandmarkMatch> Matches(const std::vector<Mode>& found,
                                   const std::vector<Mode>& known,
                                   const AnonymousMergeOptions& options) {
  const double gate = ChiSquareQuantile(options.gate_probability, 2);
  const Eigen::Matrix2d floor =
      Eigen::Matrix2d::Identity() * (2.0 * options.position_floor_m * options.position_floor_m);
  std::vector<LandmarkMatch> matches;
  for (std::size_t i = 0; i < found.size(); ++i) {
    for (std::size_t j = 0; j < known.size(); ++j) {
      const Eigen::Vector2d difference = found[i].p_map_landmark - known[j].p_map_landmark;
      if (difference.norm() > options.distance_m) continue;
      const double squared = SquaredMahalanobis(
          difference, found[i].cov_p_map_landmark + known[j].cov_p_map_landmark + floor);
      if (squared <= gate) matches.push_back({squared, i, j});
    }
  }
  std::sort(matches.begin(), matches.end(), [](const LandmarkMatch& a, const LandmarkMatch& b) {
    return std::tie(a.squared_distance, a.found, a.known) <
           std::tie(b.squared_distance, b.found, b.known);
  });
  return matches;
}

}  // namespace

void AddAnonymousLandmarks(const std::vector<Mode>& found,
                           const AnonymousMergeOptions& options,
                           std::vector<Mode>* landmarks) {
  std::vector<bool> placed(found.size());
  std::vector<bool> taken(landmarks->size());
  for (const LandmarkMatch& match : Matches(found, *landmarks, options)) {
    if (placed[match.found] || taken[match.known]) continue;
    placed[match.found] = taken[match.known] = true;
    Mode& known = (*landmarks)[match.known];
    const Mode& other = found[match.found];
    known.last_seen = std::max(known.last_seen, other.last_seen);
    if (other.cov_p_map_landmark.trace() >= known.cov_p_map_landmark.trace()) continue;
    known.p_map_landmark = other.p_map_landmark;
    known.cov_p_map_landmark = other.cov_p_map_landmark;
  }
  ModeNumber last = kAbsent;
  for (const Mode& landmark : *landmarks) last = std::max(last, landmark.number);
  for (std::size_t i = 0; i < found.size(); ++i) {
    if (placed[i]) continue;
    last = ModeNumber(last.value() + 1);
    landmarks->push_back(found[i]);
    landmarks->back().number = last;
  }
}

}  // namespace shiftmap
