// SPDX-License-Identifier: Apache-2.0
#include "localizer/hypothesis/tree_view.h"

namespace shiftmap {

void TreeView::Add(const std::vector<int>& states, double log_weight, int leaf) {
  std::size_t node = 0;
  const auto count = [&] {
    nodes_[node].log_probability = LogAdd(nodes_[node].log_probability, log_weight);
  };
  count();
  for (std::size_t level = 0; level < states.size(); ++level) {
    node = Child(node, groups_[level], states[level]);
    count();
  }
  if (nodes_[node].leaf < 0) nodes_[node].leaf = leaf;
}

std::size_t TreeView::Child(std::size_t parent, int group, int state) {
  for (const std::size_t child : nodes_[parent].children) {
    if (nodes_[child].state == state) return child;
  }
  nodes_[parent].children.push_back(nodes_.size());
  nodes_.push_back({.group = group, .state = state});
  return nodes_.size() - 1;
}

int TreeView::GlobalHypothesis() const {
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
