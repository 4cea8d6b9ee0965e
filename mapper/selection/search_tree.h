// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <vector>

namespace shiftmap {

/// The least and the largest of some values.
struct ValueRange {
  double min = 0.0;
  double max = 0.0;
};

/// Q̄ of IJRR (26): where a value lies between the least and the largest of the tree, in [0, 1]; 0
/// if these are equal.
double NormalizedValue(double value, const ValueRange& range);

/// Upper confidence bound for trees, IJRR (25): Q̄ + C_p √(ln n / n_i).
/// @param exploration     C_p > 0.
/// @param parent_visits   n >= 1.
/// @param visits          n_i >= 1.
double UctScore(double normalized_value, double exploration, int parent_visits, int visits);

/// The statistics of a Monte Carlo tree search: every node has one child per state, which may not
/// have been visited yet. Nodes are numbered in the order of their making, the root is 0.
class SearchTree {
 public:
  static constexpr int kRoot = 0;
  static constexpr int kNoNode = -1;

  /// A tree of one node. @param branching  Children per node; > 0.
  explicit SearchTree(int branching);

  int size() const { return static_cast<int>(nodes_.size()); }
  int branching() const { return branching_; }

  /// kNoNode if the child has not been visited.
  int Child(int node, int state) const;

  /// Makes a child that is not there yet and returns its number.
  int Expand(int node, int state);

  /// The state of the child that the tree policy goes to, IJRR (25) and (26): unvisited ones are
  /// not considered. Of equal ones the smallest. Precondition: a child has been visited.
  int BestChild(int node, double exploration, const ValueRange& range) const;

  /// States of the children that have not been visited.
  std::vector<int> UnvisitedChildren(int node) const;

  /// Counts a sequence of the given value through a node.
  void Record(int node, double value);

  int Visits(int node) const { return At(node).visits; }

  /// Q of IJRR (24): the mean value of the sequences through a visited node.
  double Value(int node) const { return At(node).value; }

  /// Over Q of all visited nodes.
  ValueRange Range() const;

 private:
  struct Node {
    int visits = 0;
    double value_sum = 0.0;
    double value = 0.0;  // The mean.
  };

  std::size_t ChildIndex(int node, int state) const {
    return static_cast<std::size_t>(node) * static_cast<std::size_t>(branching_) +
           static_cast<std::size_t>(state);
  }
  const Node& At(int node) const { return nodes_[static_cast<std::size_t>(node)]; }

  int branching_;
  std::vector<Node> nodes_;
  std::vector<int> children_;  // `branching_` for every node.
};

}  // namespace shiftmap
