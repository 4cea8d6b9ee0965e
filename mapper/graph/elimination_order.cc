// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/elimination_order.h"

#include <metis.h>

#include <Eigen/OrderingMethods>
#include <Eigen/SparseCore>
#include <array>
#include <cstddef>
#include <mutex>
#include <optional>
#include <utility>

namespace shiftmap {
namespace {

using Nodes = std::vector<int>;
using Lists = std::vector<Nodes>;

// Parts of up to as many nodes are ordered by minimum degree.
constexpr std::size_t kLeafNodes = 120;

std::size_t AsIndex(int i) { return static_cast<std::size_t>(i); }

// The others that each node couples with: those of node i from others[begin[i]] to
// others[begin[i + 1]].
struct Adjacency {
  std::vector<idx_t> begin = {0};
  std::vector<idx_t> others;

  int nodes() const { return static_cast<int>(begin.size()) - 1; }
};

Adjacency MakeAdjacency(int nodes, const Lists& cliques) {
  Lists cliques_of(AsIndex(nodes));
  for (std::size_t c = 0; c < cliques.size(); ++c) {
    for (const int node : cliques[c]) cliques_of[AsIndex(node)].push_back(static_cast<int>(c));
  }
  Adjacency adjacency;
  Nodes mark(AsIndex(nodes), -1);
  for (int node = 0; node < nodes; ++node) {
    mark[AsIndex(node)] = node;
    for (const int c : cliques_of[AsIndex(node)]) {
      for (const int other : cliques[AsIndex(c)]) {
        if (std::exchange(mark[AsIndex(other)], node) != node) adjacency.others.push_back(other);
      }
    }
    adjacency.begin.push_back(static_cast<idx_t>(adjacency.others.size()));
  }
  return adjacency;
}

Nodes MinimumDegree(const Adjacency& adjacency) {
  const int nodes = adjacency.nodes();
  std::vector<Eigen::Triplet<double>> entries;
  for (int node = 0; node < nodes; ++node) {
    entries.emplace_back(node, node, 1.0);
    for (idx_t i = adjacency.begin[AsIndex(node)]; i < adjacency.begin[AsIndex(node) + 1]; ++i) {
      if (adjacency.others[AsIndex(i)] < node)
        entries.emplace_back(node, adjacency.others[AsIndex(i)], 1.0);
    }
  }
  Eigen::SparseMatrix<double> pattern(nodes, nodes);
  pattern.setFromTriplets(entries.begin(), entries.end());
  Eigen::PermutationMatrix<Eigen::Dynamic, Eigen::Dynamic, int> order;
  Eigen::AMDOrdering<int>()(pattern, order);
  return {order.indices().begin(), order.indices().end()};
}

// Two parts of some nodes that do not couple with each other, and what is between them.
struct Division {
  std::array<Nodes, 2> parts;
  Nodes between;
};

// Nothing if the nodes cannot be taken apart.
// @param adjacency  Is not changed; METIS takes no constants.
// @param sizes      Unknowns of each node.
std::optional<Division> Divide(Adjacency& adjacency, std::vector<idx_t> sizes) {
  static std::mutex mutex;  // METIS draws from the random numbers of the process.
  idx_t count = adjacency.nodes();
  idx_t separator = 0;
  std::vector<idx_t> part(sizes.size());
  idx_t options[METIS_NOPTIONS];
  METIS_SetDefaultOptions(options);
  options[METIS_OPTION_SEED] = 1;
  {
    const std::lock_guard<std::mutex> lock(mutex);
    // Not METIS_NodeND(), which takes SIGTERM and SIGABRT for errors of its own while it runs.
    const int status = METIS_ComputeVertexSeparator(&count,
                                                    adjacency.begin.data(),
                                                    adjacency.others.data(),
                                                    sizes.data(),
                                                    options,
                                                    &separator,
                                                    part.data());
    if (status != METIS_OK) return std::nullopt;
  }
  Division division;
  for (int node = 0; node < count; ++node) {
    const idx_t side = part[AsIndex(node)];
    (side < 2 ? division.parts[AsIndex(side)] : division.between).push_back(node);
  }
  if (division.parts[0].empty() || division.parts[1].empty()) return std::nullopt;
  return division;
}

class Dissection {
 public:
  Dissection(const std::vector<int>& node_sizes, const Lists& cliques)
      : sizes_(node_sizes),
        adjacency_(MakeAdjacency(static_cast<int>(node_sizes.size()), cliques)),
        local_(node_sizes.size(), -1) {}

  Nodes Order() {
    Nodes all;
    for (int node = 0; node < adjacency_.nodes(); ++node) all.push_back(node);
    Dissect(all);
    return std::move(order_);
  }

 private:
  // Orders the nodes of a part after all that are ordered so far.
  void Dissect(const Nodes& part) {
    Adjacency within = Within(part);
    const auto add = [&](const Nodes& nodes) {
      for (const int node : nodes) order_.push_back(part[AsIndex(node)]);
    };
    std::optional<Division> division;
    if (part.size() > kLeafNodes) division = Divide(within, SizesOf(part));
    if (!division) {
      add(MinimumDegree(within));
      return;
    }
    for (const Nodes& nodes : division->parts) {
      Nodes of_part;
      for (const int node : nodes) of_part.push_back(part[AsIndex(node)]);
      Dissect(of_part);
    }
    add(division->between);
  }

  // How the nodes of a part couple with each other, numbered by their places in it.
  Adjacency Within(const Nodes& part) {
    for (std::size_t i = 0; i < part.size(); ++i) local_[AsIndex(part[i])] = static_cast<int>(i);
    Adjacency within;
    for (const int node : part) {
      for (idx_t i = adjacency_.begin[AsIndex(node)]; i < adjacency_.begin[AsIndex(node) + 1];
           ++i) {
        const int other = local_[AsIndex(adjacency_.others[AsIndex(i)])];
        if (other >= 0) within.others.push_back(other);
      }
      within.begin.push_back(static_cast<idx_t>(within.others.size()));
    }
    for (const int node : part) local_[AsIndex(node)] = -1;
    return within;
  }

  std::vector<idx_t> SizesOf(const Nodes& part) const {
    std::vector<idx_t> sizes;
    for (const int node : part) sizes.push_back(sizes_[AsIndex(node)]);
    return sizes;
  }

  const std::vector<int>& sizes_;
  const Adjacency adjacency_;
  Nodes order_;
  Nodes local_;  // Place of each node in the part at hand; -1 if it is not in it.
};

}  // namespace

std::vector<int> MinimumDegreeOrder(int nodes, const Lists& cliques) {
  return MinimumDegree(MakeAdjacency(nodes, cliques));
}

std::vector<int> DissectionOrder(const std::vector<int>& node_sizes, const Lists& cliques) {
  return Dissection(node_sizes, cliques).Order();
}

}  // namespace shiftmap
