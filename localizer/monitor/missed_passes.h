// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <vector>

#include "localizer/hypothesis/hypothesis_bank.h"

namespace shiftmap {

/// Finds landmarks that stand nowhere: missed in several passes and from all around.
///
/// A pass by a mode that is well inside the field of view and not seen is bounded evidence: with
/// probability ε (`occluded_visit_probability`) something stands before it, for the whole pass.
/// Three passes make ε³. And what is seen from one side only, as a sign on a wall, is missed from
/// behind in every pass; so the directions that the mode was missed from must leave no gap of half
/// a circle. Once seen, a landmark starts again. One that the map holds for absent is no news,
/// unless it was decided to stand at a mode.
///
/// Memory: as much as its constructor takes.
class MissedPasses {
 public:
  explicit MissedPasses(const MapSnapshot& snapshot);

  /// Takes a scan in that the pose explains.
  /// @param bank  After it; says where the field of view is.
  /// @return Groups of which a mode was just missed in the third pass or a later one, all others
  /// being
  ///         unlikely or missed as well.
  std::vector<int> Add(const Scan& scan, const HypothesisBank& bank, const MapSnapshot& snapshot);

  void Reset();

 private:
  static constexpr std::size_t kDirections = 8;

  // What was missed at one mode since its landmark was seen last.
  struct Misses {
    std::array<double, kDirections> from = {};  // Σ -log(1 - P_D), by the direction of view.
    double in_pass = 0.0;                       // The same, of the present pass.
    int passes = 0;
    bool seen_in_pass = false;
    Stamp in_view = Stamp::min();
  };

  Misses& Of(int group, int state, const MapSnapshot& snapshot) {
    return misses_[static_cast<std::size_t>(snapshot.ModeIndex(group, state))];
  }
  static bool FromAllAround(const Misses& misses);
  static bool Complete(const Misses& misses);
  void Seen(int group, Stamp stamp, const MapSnapshot& snapshot);
  // True if that makes the present pass count, and there are enough of them.
  bool Missed(const Eigen::Vector2d& view, double log_miss, Stamp stamp, Misses* misses);
  bool NoOtherIsLikely(int group, const HypothesisBank& bank, const MapSnapshot& snapshot);

  std::vector<Misses> misses_;  // By ModeIndex().
  std::vector<bool> stood_;     // By group: decided to stand at a mode.
};

}  // namespace shiftmap
