// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/elimination_order.h"

#include <Eigen/OrderingMethods>
#include <Eigen/SparseCore>
#include <algorithm>
#include <cstddef>
#include <utility>

namespace shiftmap {
namespace {

using Lists = std::vector<std::vector<int>>;

// Parts of up to as many nodes are ordered by minimum degree.
constexpr std::size_t kLeafNodes = 120;

// Shares of a part's nodes between which it is taken apart, where the fewest nodes do so.
constexpr double kLeastShare = 0.4;
constexpr double kLargestShare = 0.6;

std::size_t At(int i) { return static_cast<std::size_t>(i); }

Lists CliquesOf(int nodes, const Lists& cliques) {
  Lists cliques_of(At(nodes));
  for (std::size_t c = 0; c < cliques.size(); ++c) {
    for (const int node : cliques[c]) cliques_of[At(node)].push_back(static_cast<int>(c));
  }
  return cliques_of;
}

class Dissection {
 public:
  Dissection(int nodes, const Lists& cliques)
      : cliques_(cliques),
        cliques_of_(CliquesOf(nodes, cliques)),
        part_of_(At(nodes), 0),
        level_(At(nodes), -1),
        local_(At(nodes), -1),
        reached_(cliques.size(), -1) {}

  std::vector<int> Order() {
    std::vector<int> all;
    for (int node = 0; node < static_cast<int>(part_of_.size()); ++node) all.push_back(node);
    Dissect(std::move(all));
    return std::move(order_);
  }

 private:
  // Orders the nodes of a part after all that are ordered so far.
  void Dissect(std::vector<int> part) {
    while (part.size() > kLeafNodes) {
      ++last_part_;
      for (const int node : part) part_of_[At(node)] = last_part_;
      std::vector<int> reached = Search(part.front());
      if (reached.size() < part.size()) {
        std::erase_if(part, [&](int node) { return level_[At(node)] >= 0; });
        Dissect(std::move(reached));
        continue;
      }
      // From one end of the part to the other.
      reached = Search(reached.back());
      reached = Search(reached.back());
      if (!Divide(reached)) break;
      return;
    }
    AddLeaf(part);
  }

  // Nodes of the last part by their distance from one of them, which level_ tells; -1 of those that
  // cannot be reached.
  std::vector<int> Search(int start) {
    const int part = part_of_[At(start)];
    for (const int node : members_) level_[At(node)] = -1;
    ++search_;
    members_ = {start};
    level_[At(start)] = 0;
    for (std::size_t i = 0; i < members_.size(); ++i) {
      const int node = members_[i];
      for (const int c : cliques_of_[At(node)]) {
        if (std::exchange(reached_[At(c)], search_) == search_) continue;
        for (const int other : cliques_[At(c)]) {
          if (part_of_[At(other)] != part || level_[At(other)] >= 0) continue;
          level_[At(other)] = level_[At(node)] + 1;
          members_.push_back(other);
        }
      }
    }
    return members_;
  }

  // The level that takes a part apart; -1 if none does.
  int MiddleLevel(const std::vector<int>& reached) const {
    std::vector<std::size_t> sizes(At(level_[At(reached.back())]) + 1);
    for (const int node : reached) ++sizes[At(level_[At(node)])];
    const auto count = static_cast<double>(reached.size());
    std::size_t before = 0;
    int best = -1;
    for (std::size_t k = 0; k + 1 < sizes.size(); ++k) {
      before += sizes[k];
      if (static_cast<double>(before) < kLeastShare * count) continue;
      if (best >= 0 && static_cast<double>(before) > kLargestShare * count) break;
      if (best < 0 || sizes[k] < sizes[At(best)]) best = static_cast<int>(k);
    }
    return best;
  }

  bool TouchesLevel(int node, int level) const {
    const int part = part_of_[At(node)];
    for (const int c : cliques_of_[At(node)]) {
      for (const int other : cliques_[At(c)]) {
        if (part_of_[At(other)] == part && level_[At(other)] == level) return true;
      }
    }
    return false;
  }

  // False if nothing takes the part apart.
  bool Divide(const std::vector<int>& reached) {
    const int middle = MiddleLevel(reached);
    if (middle < 0) return false;
    std::vector<int> near;
    std::vector<int> far;
    std::vector<int> between;
    for (const int node : reached) {
      const int level = level_[At(node)];
      if (level > middle) {
        far.push_back(node);
      } else if (level == middle && TouchesLevel(node, middle + 1)) {
        between.push_back(node);
      } else {
        near.push_back(node);
      }
    }
    if (near.empty() || far.empty()) return false;
    Dissect(std::move(near));
    Dissect(std::move(far));
    order_.insert(order_.end(), between.begin(), between.end());
    return true;
  }

  void AddLeaf(const std::vector<int>& part) {
    for (std::size_t i = 0; i < part.size(); ++i) local_[At(part[i])] = static_cast<int>(i);
    ++search_;
    Lists within;
    for (const int node : part) {
      for (const int c : cliques_of_[At(node)]) {
        if (std::exchange(reached_[At(c)], search_) == search_) continue;
        std::vector<int>& clique = within.emplace_back();
        for (const int other : cliques_[At(c)]) {
          if (local_[At(other)] >= 0) clique.push_back(local_[At(other)]);
        }
      }
    }
    for (const int i : MinimumDegreeOrder(static_cast<int>(part.size()), within)) {
      order_.push_back(part[At(i)]);
    }
    for (const int node : part) local_[At(node)] = -1;
  }

  const Lists& cliques_;
  const Lists cliques_of_;
  std::vector<int> order_;
  std::vector<int> part_of_;
  int last_part_ = 0;
  std::vector<int> level_;    // Of the last search.
  std::vector<int> members_;  // Of the last search.
  std::vector<int> local_;    // In the leaf at hand.
  std::vector<int> reached_;  // Per clique the last search that was there.
  int search_ = 0;
};

}  // namespace

std::vector<int> MinimumDegreeOrder(int nodes, const Lists& cliques) {
  const Lists cliques_of = CliquesOf(nodes, cliques);
  std::vector<Eigen::Triplet<double>> entries;
  std::vector<int> mark(At(nodes), -1);
  for (int node = 0; node < nodes; ++node) {
    for (const int c : cliques_of[At(node)]) {
      for (const int other : cliques[At(c)]) {
        if (std::exchange(mark[At(other)], node) == node) continue;
        if (other <= node) entries.emplace_back(node, other, 1.0);
      }
    }
  }
  Eigen::SparseMatrix<double> pattern(nodes, nodes);
  pattern.setFromTriplets(entries.begin(), entries.end());
  Eigen::PermutationMatrix<Eigen::Dynamic, Eigen::Dynamic, int> order;
  Eigen::AMDOrdering<int>()(pattern, order);
  return {order.indices().begin(), order.indices().end()};
}

std::vector<int> DissectionOrder(int nodes, const Lists& cliques) {
  return Dissection(nodes, cliques).Order();
}

}  // namespace shiftmap
