// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "localizer/hypothesis/hypothesis_bank.h"
#include "mapstore/core/ids.h"
#include "mapstore/core/stamp.h"
#include "mapstore/geometry/se2.h"

namespace shiftmap {

/// What a vehicle believes and why, for people: the tree of its heaviest hypotheses, and what the
/// visits under way say. Names signatures and modes, not indices.
struct HypothesisView {
  /// Leaves in the tree at most.
  static constexpr int kMaxLeaves = 16;

  /// As HypothesisTree::Node. Below the root it says where one landmark is.
  struct Node {
    int parent = -1;                 ///< Into `nodes`; -1: the root.
    Signature signature;             ///< Anonymous for the root.
    std::optional<ModeNumber> mode;  ///< Nothing: several that share the pose.
    double probability = 0.0;
    std::optional<Se2> T_map_vehicle;  ///< Where a way from the root ends.
  };

  /// A group in view or seen within the last seconds.
  struct VisitView {
    Signature signature;
    Stamp begin;
    std::int64_t observations = 0;
    std::optional<ModeNumber> decided;

    struct ModeProbability {
      ModeNumber mode;
      double probability = 0.0;
    };
    std::vector<ModeProbability> probabilities;  ///< `absent` first, then by ascending number.
  };

  std::int64_t leaves = 0;            ///< In the bank; the tree has the heaviest of them.
  double probability_left_out = 0.0;  ///< Of leaves that are not in the tree.
  double dropped_mass_max = 0.0;      ///< As HypothesisBank::dropped_mass_max().
  std::vector<Node> nodes;            ///< Parents before their children; the root is first.
  int global_hypothesis = 0;          ///< Into `nodes`: HypothesisTree::GlobalHypothesis().
  std::vector<VisitView> visits;
};

/// @param snapshot  That of the bank.
HypothesisView ViewHypotheses(const HypothesisBank& bank, const MapSnapshot& snapshot);

}  // namespace shiftmap
