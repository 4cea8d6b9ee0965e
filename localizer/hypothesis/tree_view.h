// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstddef>
#include <limits>
#include <vector>

#include "localizer/hypothesis/group_belief.h"
#include "localizer/hypothesis/leaf_set.h"
#include "proto/core/check.h"

namespace shiftmap {

/// The leaves of a HypothesisTree with their inner nodes, T-IV V-A, for looking at.
///
/// A level is a group of which leaves hold different states; groups of which all leaves hold the
/// same are left out. A node stands for the states of the groups on the way to it, and its score is
/// the sum over the leaves below it, T-IV (25). A complete way ends at a node with a leaf, or with
/// several that hold the same states and differ in where the vehicle is.
class TreeView {
 public:
  struct Node {
    int group = -1;                          ///< Index of the group; -1: the root.
    int state = GroupBelief::kUnresolved;    ///< Or several that share the filter: kUnresolved.
    double log_probability = kLogZero;       ///< Given all that was seen, of its leaves.
    std::vector<std::size_t> children = {};  ///< Into nodes().
    int leaf = -1;  ///< Of a node without children, the heaviest: into the leaves.
  };

  /// @param leaves      Not empty, by descending weight, weights sum to 1.
  /// @param max_leaves  The tree is of this many of the heaviest, >= 1.
  template <class LeafType>
  explicit TreeView(const LeafSet<LeafType>& leaves,
                    std::size_t max_leaves = std::numeric_limits<std::size_t>::max());

  /// Parents before their children; the root is first.
  const std::vector<Node>& nodes() const { return nodes_; }

  /// Groups by level below the root.
  const std::vector<int>& groups() const { return groups_; }

  /// The leaf that descending from the root to the likeliest child each time ends at, T-IV VIII-B.
  /// It need not be the heaviest leaf.
  int GlobalHypothesis() const;

 private:
  // Adds a way from the root: one state per level.
  void Add(const std::vector<int>& states, double log_weight, int leaf);
  std::size_t Child(std::size_t parent, int group, int state);

  std::vector<Node> nodes_;
  std::vector<int> groups_;
};

template <class LeafType>
TreeView::TreeView(const LeafSet<LeafType>& leaves, std::size_t max_leaves) : nodes_(1) {
  SHIFTMAP_CHECK(!leaves.empty() && max_leaves > 0, "a tree of no leaves");
  const auto heaviest = leaves.all().first(std::min(leaves.size(), max_leaves));
  const auto& first = leaves.front().beliefs;
  std::vector<std::size_t> levels;  // Into Leaf::beliefs.
  for (std::size_t i = 0; i < first.size(); ++i) {
    const bool same = std::all_of(heaviest.begin(), heaviest.end(), [&](const LeafType* leaf) {
      return leaf->beliefs[i].resolved == first[i].resolved;
    });
    if (same) continue;
    groups_.push_back(first[i].group);
    levels.push_back(i);
  }
  for (std::size_t leaf = 0; leaf < heaviest.size(); ++leaf) {
    std::vector<int> states;
    for (const std::size_t i : levels) states.push_back(heaviest[leaf]->beliefs[i].resolved);
    Add(states, heaviest[leaf]->log_weight, static_cast<int>(leaf));
  }
}

}  // namespace shiftmap
