// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapper/graph/graph.h"

namespace shiftmap::testing {

struct CircleShape {
  int runs = 1;
  int frames = 100;
  int modes = 6;
  double disturbance = 0.02;  ///< Of the start, in every value.
};

/// The graph of vehicles on a circle of 4 m among modes on one of 6 m, each seen when it is near.
Graph MakeCircleGraph(const CircleShape& shape, unsigned seed);

/// A prior of 5 cm at the graph's modes.
GraphPrior MakeModesPrior(const Graph& graph);

}  // namespace shiftmap::testing
