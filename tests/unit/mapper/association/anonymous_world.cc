// SPDX-License-Identifier: Apache-2.0
#include "tests/unit/mapper/association/anonymous_world.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <random>

namespace shiftmap::testing {

AnonymousRun Anonymize(const Run& run,
                       const std::vector<Signature>& keep,
                       double clutter_per_scan,
                       std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::poisson_distribution<int> clutter(clutter_per_scan);
  std::uniform_real_distribution<double> x(1.0, 8.0);
  std::uniform_real_distribution<double> y(-4.0, 4.0);
  AnonymousRun out{run, {}};
  for (Scan& scan : out.run.scans) {
    std::vector<Signature>& truth = out.truth.emplace_back();
    for (Observation& observation : scan.observations) {
      truth.push_back(observation.signature);
      if (std::find(keep.begin(), keep.end(), observation.signature) == keep.end()) {
        observation.signature = Signature();
      }
    }
    const int count = clutter_per_scan > 0.0 ? clutter(random) : 0;
    for (int i = 0; i < count; ++i) {
      Observation observation;
      observation.kind = Observation::Kind::kRangeBearing;
      const Eigen::Vector2d q(x(random), y(random));
      observation.z = {q.norm(), std::atan2(q.y(), q.x())};
      scan.observations.push_back(observation);
      truth.emplace_back();
    }
  }
  return out;
}

AssociationScore Score(const AnonymousRun& truth,
                       const AnonymousAssociation& found,
                       const AssociationOptions& options) {
  std::vector<std::map<Signature, int>> votes(found.tracks.size());
  std::map<Signature, int> sightings;
  const auto for_each = [&](const auto& visit) {
    for (std::size_t i = 0; i < truth.truth.size(); ++i) {
      for (std::size_t j = 0; j < truth.truth[i].size(); ++j) {
        if (!truth.run.scans[i].observations[j].signature.anonymous()) continue;
        visit(truth.truth[i][j], found.track_of[i][j]);
      }
    }
  };
  for_each([&](const Signature& signature, int track) {
    if (!signature.anonymous()) ++sightings[signature];
    if (track >= 0) ++votes[static_cast<std::size_t>(track)][signature];
  });
  std::vector<Signature> landmark_of;
  for (const std::map<Signature, int>& of_track : votes) {
    landmark_of.push_back(
        std::max_element(of_track.begin(), of_track.end(), [](const auto& a, const auto& b) {
          return a.second < b.second;
        })->first);
  }
  double right = 0.0;
  double associated = 0.0;
  double of_landmarks = 0.0;
  for_each([&](const Signature& signature, int track) {
    of_landmarks += signature.anonymous() ? 0.0 : 1.0;
    if (track < 0) return;
    associated += 1.0;
    const Signature& landmark = landmark_of[static_cast<std::size_t>(track)];
    right += !landmark.anonymous() && landmark == signature ? 1.0 : 0.0;
  });
  AssociationScore score{right / associated, right / of_landmarks, 0, 0};
  score.tracks = static_cast<int>(found.tracks.size());
  for (const auto& [signature, count] : sightings) {
    score.landmarks += count >= options.min_sightings ? 1 : 0;
  }
  return score;
}

}  // namespace shiftmap::testing
