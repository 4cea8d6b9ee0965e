// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

namespace shiftmap {

/// In which order to eliminate nodes so that few entries of a factor are filled: approximate
/// minimum degree (Amestoy, Davis, Duff 1996).
/// @param cliques  Nodes that couple with each other, each list a clique.
std::vector<int> MinimumDegreeOrder(int nodes, const std::vector<std::vector<int>>& cliques);

/// The same by nested dissection (George 1973): a few nodes that take the rest apart are last, and
/// so on in either part. Better than minimum degree where nodes are many. METIS finds the nodes
/// (Karypis, Kumar 1998).
/// @param node_sizes  Unknowns of each node, > 0.
/// @param cliques     As above.
/// Deterministic, and safe to call from several threads.
std::vector<int> DissectionOrder(const std::vector<int>& node_sizes,
                                 const std::vector<std::vector<int>>& cliques);

}  // namespace shiftmap
