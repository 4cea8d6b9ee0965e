// SPDX-License-Identifier: Apache-2.0
#include "mapper/selection/search_tree.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "proto/core/check.h"

namespace shiftmap {

double NormalizedValue(double value, const ValueRange& range) {
  if (!(range.max > range.min)) return 0.0;
  return (value - range.min) / (range.max - range.min);
}

double UctScore(double normalized_value, double exploration, int parent_visits, int visits) {
  return normalized_value + exploration * std::sqrt(std::log(parent_visits) / visits);
}

SearchTree::SearchTree(int branching)
    : branching_(branching), nodes_(1), children_(static_cast<std::size_t>(branching), kNoNode) {}

int SearchTree::Child(int node, int state) const { return children_[ChildIndex(node, state)]; }

int SearchTree::Expand(int node, int state) {
  int& child = children_[ChildIndex(node, state)];
  SHIFTMAP_CHECK(child == kNoNode, "child {} of node {} is there already", state, node);
  child = size();
  const int made = child;
  nodes_.emplace_back();
  children_.resize(children_.size() + static_cast<std::size_t>(branching_), kNoNode);
  return made;
}

int SearchTree::BestChild(int node, double exploration, const ValueRange& range) const {
  int best = kNoNode;
  double best_score = -std::numeric_limits<double>::infinity();
  for (int state = 0; state < branching_; ++state) {
    const int child = Child(node, state);
    if (child == kNoNode) continue;
    const double score =
        UctScore(NormalizedValue(Value(child), range), exploration, Visits(node), Visits(child));
    if (best == kNoNode || score > best_score) {
      best = state;
      best_score = score;
    }
  }
  SHIFTMAP_CHECK(best != kNoNode, "node {} has no visited child", node);
  return best;
}

std::vector<int> SearchTree::UnvisitedChildren(int node) const {
  std::vector<int> unvisited;
  for (int state = 0; state < branching_; ++state) {
    if (Child(node, state) == kNoNode) unvisited.push_back(state);
  }
  return unvisited;
}

void SearchTree::Record(int node, double value) {
  Node& at = nodes_[static_cast<std::size_t>(node)];
  ++at.visits;
  at.value_sum += value;
  at.value = at.value_sum / at.visits;
}

ValueRange SearchTree::Range() const {
  ValueRange range{std::numeric_limits<double>::infinity(),
                   -std::numeric_limits<double>::infinity()};
  for (const Node& node : nodes_) {
    if (node.visits == 0) continue;
    range.min = std::min(range.min, node.value);
    range.max = std::max(range.max, node.value);
  }
  return range;
}

}  // namespace shiftmap
