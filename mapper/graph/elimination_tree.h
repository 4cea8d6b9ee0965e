// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

namespace shiftmap {

/// Variables that are eliminated at once from a sparse symmetric system, and what they couple with
/// by then: one dense front of the multifrontal method (Duff, Reid 1983).
struct Front {
  std::vector<int> rows;  ///< Nodes in the order of elimination, its own first.
  int own = 0;            ///< How many of `rows` are eliminated here.
  int parent = -1;        ///< The front that takes what is left over the other rows; -1 at a root.
};

/// In which order a system is eliminated.
struct EliminationTree {
  std::vector<Front> fronts;       ///< Children before parents.
  std::vector<int> front_of_node;  ///< Where each node is eliminated.
};

/// A fill-reducing order (elimination_order.h) of a system whose terms each couple the nodes
/// of a clique. Fronts that hardly differ from their parent are joined with it: a few zeros cost
/// less than another front.
/// @param node_sizes  Unknowns of each node.
/// @param cliques     Nodes, each once in a clique.
/// Deterministic.
EliminationTree MakeEliminationTree(const std::vector<int>& node_sizes,
                                    const std::vector<std::vector<int>>& cliques);

}  // namespace shiftmap
