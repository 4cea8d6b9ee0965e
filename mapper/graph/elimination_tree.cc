// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/elimination_tree.h"

#include <algorithm>
#include <utility>

#include "mapper/graph/elimination_order.h"

namespace shiftmap {
namespace {

// A front is joined with its parent while they are narrow, or few of their entries are zeros.
constexpr int kNarrow = 24;            // [unknowns]
constexpr double kMaxZeroShare = 0.2;  // [-]

// Up to as many nodes minimum degree is as good as nested dissection.
constexpr int kMinDissected = 1000;

using Lists = std::vector<std::vector<int>>;

std::vector<int> Inverse(const std::vector<int>& order) {
  std::vector<int> position(order.size());
  for (std::size_t i = 0; i < order.size(); ++i) {
    position[static_cast<std::size_t>(order[i])] = static_cast<int>(i);
  }
  return position;
}

// By position of elimination: which later positions each couples with by then, unsorted, and the
// first of them.
struct Structure {
  Lists later;
  std::vector<int> parent;
};

Structure Eliminate(const std::vector<int>& position, const Lists& cliques) {
  const std::size_t nodes = position.size();
  Structure structure{Lists(nodes), std::vector<int>(nodes, -1)};
  Lists first_cliques(nodes);
  Lists children(nodes);
  for (std::size_t c = 0; c < cliques.size(); ++c) {
    int first = static_cast<int>(nodes);
    for (const int node : cliques[c]) {
      first = std::min(first, position[static_cast<std::size_t>(node)]);
    }
    if (!cliques[c].empty()) {
      first_cliques[static_cast<std::size_t>(first)].push_back(static_cast<int>(c));
    }
  }
  std::vector<int> mark(nodes, -1);
  for (std::size_t j = 0; j < nodes; ++j) {
    const auto own = static_cast<int>(j);
    mark[j] = own;
    std::vector<int>& later = structure.later[j];
    const auto add = [&](int other) {
      if (std::exchange(mark[static_cast<std::size_t>(other)], own) != own) later.push_back(other);
    };
    for (const int c : first_cliques[j]) {
      for (const int node : cliques[static_cast<std::size_t>(c)]) {
        add(position[static_cast<std::size_t>(node)]);
      }
    }
    for (const int child : children[j]) {
      for (const int other : structure.later[static_cast<std::size_t>(child)]) add(other);
    }
    if (later.empty()) continue;
    structure.parent[j] = *std::min_element(later.begin(), later.end());
    children[static_cast<std::size_t>(structure.parent[j])].push_back(own);
  }
  return structure;
}

// Positions so that every subtree is contiguous and ends with its root.
std::vector<int> Postorder(const std::vector<int>& parent) {
  const std::size_t nodes = parent.size();
  std::vector<int> size(nodes, 1);
  for (std::size_t j = 0; j < nodes; ++j) {
    if (parent[j] >= 0) size[static_cast<std::size_t>(parent[j])] += size[j];
  }
  // Where the next subtree below a node ends, from the roots down.
  std::vector<int> place(nodes);
  std::vector<int> end(nodes);
  auto end_of_roots = static_cast<int>(nodes);
  for (std::size_t j = nodes; j-- > 0;) {
    int& room = parent[j] >= 0 ? end[static_cast<std::size_t>(parent[j])] : end_of_roots;
    place[j] = room - 1;
    end[j] = room - 1;
    room -= size[j];
  }
  return place;
}

class FrontMaker {
 public:
  FrontMaker(const std::vector<int>& node_sizes,
             const std::vector<int>& order,
             const Structure& structure)
      : node_sizes_(node_sizes), order_(order), structure_(structure) {}

  EliminationTree Make() {
    EliminationTree tree;
    tree.front_of_node.resize(order_.size());
    for (std::size_t first = 0; first < order_.size();) {
      const std::size_t last = LastJoined(first);
      Front front;
      front.own = static_cast<int>(last - first + 1);
      for (std::size_t j = first; j <= last; ++j) {
        front.rows.push_back(order_[j]);
        tree.front_of_node[static_cast<std::size_t>(order_[j])] =
            static_cast<int>(tree.fronts.size());
      }
      std::vector<int> later = structure_.later[last];
      std::sort(later.begin(), later.end());
      for (const int j : later) front.rows.push_back(order_[static_cast<std::size_t>(j)]);
      tree.fronts.push_back(std::move(front));
      first = last + 1;
    }
    for (Front& front : tree.fronts) {
      const auto own = static_cast<std::size_t>(front.own);
      if (front.rows.size() == own) continue;
      front.parent = tree.front_of_node[static_cast<std::size_t>(front.rows[own])];
    }
    return tree;
  }

 private:
  int Size(std::size_t j) const { return node_sizes_[static_cast<std::size_t>(order_[j])]; }

  int SizeOfLater(std::size_t j) const {
    int size = 0;
    for (const int other : structure_.later[j]) size += Size(static_cast<std::size_t>(other));
    return size;
  }

  // The last position that is eliminated in one front with `first`.
  std::size_t LastJoined(std::size_t first) const {
    std::size_t last = first;
    int width = Size(first);
    int height = SizeOfLater(first);  // Below the front's own rows.
    double zeros = 0.0;
    while (structure_.parent[last] == static_cast<int>(last + 1)) {
      const int next_width = Size(last + 1);
      const int next_height = SizeOfLater(last + 1);
      zeros += static_cast<double>(width) * (next_width + next_height - height);
      const int joined = width + next_width;
      const double entries = joined * (0.5 * joined + next_height);
      if (joined > kNarrow && zeros > kMaxZeroShare * entries) break;
      width = joined;
      height = next_height;
      ++last;
    }
    return last;
  }

  const std::vector<int>& node_sizes_;
  const std::vector<int>& order_;
  const Structure& structure_;
};

}  // namespace

EliminationTree MakeEliminationTree(const std::vector<int>& node_sizes, const Lists& cliques) {
  const auto nodes = static_cast<int>(node_sizes.size());
  const std::vector<int> found = nodes >= kMinDissected ? DissectionOrder(node_sizes, cliques)
                                                        : MinimumDegreeOrder(nodes, cliques);
  const Structure structure = Eliminate(Inverse(found), cliques);
  const std::vector<int> place = Postorder(structure.parent);

  // The same structure by the positions of the postorder.
  std::vector<int> order(found.size());
  Structure ordered{Lists(found.size()), std::vector<int>(found.size(), -1)};
  for (std::size_t j = 0; j < found.size(); ++j) {
    const auto at = static_cast<std::size_t>(place[j]);
    order[at] = found[j];
    if (structure.parent[j] >= 0) {
      ordered.parent[at] = place[static_cast<std::size_t>(structure.parent[j])];
    }
    for (const int other : structure.later[j]) {
      ordered.later[at].push_back(place[static_cast<std::size_t>(other)]);
    }
  }
  return FrontMaker(node_sizes, order, ordered).Make();
}

}  // namespace shiftmap
