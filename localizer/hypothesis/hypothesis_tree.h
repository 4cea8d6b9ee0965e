// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <limits>
#include <vector>

#include "localizer/hypothesis/leaf_set.h"

namespace shiftmap {

/// The leaves of a bank as the tree of T-IV V-A, for looking at: the bank itself needs its leaves
/// only.
///
/// A level is a group of which leaves hold different states; groups of which all leaves hold the
/// same are left out. A node stands for the states of the groups on the way to it, and its score is
/// the sum over the leaves below it, T-IV (25). A complete way ends at a node with a leaf, or with
/// several that hold the same states and differ in where the vehicle is.
class HypothesisTree {
 public:
  struct Node {
    int group = -1;                          ///< Index into MapSnapshot::groups(); -1: the root.
    int state = GroupBelief::kUnresolved;    ///< Or several that share the filter: kUnresolved.
    double log_probability = kLogZero;       ///< Given all that was seen, of its leaves.
    std::vector<std::size_t> children = {};  ///< Into nodes().
    int leaf = -1;  ///< Of a node without children, the heaviest: into the leaves.
  };

  /// @param leaves      Not empty, by descending weight, weights sum to 1.
  /// @param max_leaves  The tree is of this many of the heaviest, >= 1.
  explicit HypothesisTree(const LeafSet& leaves,
                          std::size_t max_leaves = std::numeric_limits<std::size_t>::max());

  /// Parents before their children; the root is first.
  const std::vector<Node>& nodes() const { return nodes_; }

  /// Groups by level below the root.
  const std::vector<int>& groups() const { return groups_; }

  /// The leaf that descending from the root to the likeliest child each time ends at, T-IV VIII-B.
  /// It need not be the heaviest leaf.
  int GlobalHypothesis() const;

 private:
  void Add(const LeafSet& leaves, int leaf);
  std::size_t Child(std::size_t parent, int group, int state);

  std::vector<Node> nodes_;
  std::vector<int> groups_;
  std::vector<std::size_t> beliefs_;  // By level: into Leaf::beliefs.
};

}  // namespace shiftmap
