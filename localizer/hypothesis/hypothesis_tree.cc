// SPDX-License-Identifier: Apache-2.0
#include "localizer/hypothesis/hypothesis_tree.h"

#include <algorithm>

#include "proto/core/check.h"

namespace shiftmap {

HypothesisTree::HypothesisTree(const LeafSet& leaves, std::size_t max_leaves) : nodes_(1) {
  SHIFTMAP_CHECK(!leaves.empty() && max_leaves > 0, "a tree of no leaves");
  const auto heaviest = leaves.all().first(std::min(leaves.size(), max_leaves));
  const std::vector<GroupBelief>& first = leaves.front().beliefs;
  for (std::size_t i = 0; i < first.size(); ++i) {
    const bool same = std::all_of(heaviest.begin(), heaviest.end(), [&](const Leaf* leaf) {
      return leaf->beliefs[i].resolved == first[i].resolved;
    });
    if (same) continue;
    groups_.push_back(first[i].group);
    beliefs_.push_back(i);
  }
  for (std::size_t leaf = 0; leaf < heaviest.size(); ++leaf) Add(leaves, static_cast<int>(leaf));
}

void HypothesisTree::Add(const LeafSet& leaves, int leaf) {
  const Leaf& added = leaves[static_cast<std::size_t>(leaf)];
  std::size_t node = 0;
  const auto count = [&] {
    nodes_[node].log_probability = LogAdd(nodes_[node].log_probability, added.log_weight);
  };
  count();
  for (const std::size_t belief : beliefs_) {
    node = Child(node, added.beliefs[belief].group, added.beliefs[belief].resolved);
    count();
  }
  if (nodes_[node].leaf < 0) nodes_[node].leaf = leaf;
}

std::size_t HypothesisTree::Child(std::size_t parent, int group, int state) {
  for (const std::size_t child : nodes_[parent].children) {
    if (nodes_[child].state == state) return child;
  }
  nodes_[parent].children.push_back(nodes_.size());
  nodes_.push_back({.group = group, .state = state});
  return nodes_.size() - 1;
}

int HypothesisTree::GlobalHypothesis() const {
  const Node* node = &nodes_.front();
  while (!node->children.empty()) {
    const auto likelier = [&](std::size_t a, std::size_t b) {
      return nodes_[a].log_probability < nodes_[b].log_probability;
    };
    node = &nodes_[*std::max_element(node->children.begin(), node->children.end(), likelier)];
  }
  return node->leaf;
}

}  // namespace shiftmap
