// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapper/graph/graph.h"
#include "mapper/graph/graph_step.h"

namespace shiftmap {

/// Moves a graph in which no loop is closed along a step. What the step does to the heading
/// somewhere turns everything after it, by an angle that adds up; poses that each go straight where
/// they ought to turn end up apart from what is seen from them. So motions between poses are
/// changed and put together again, and each mode goes along with a pose that sees it. To first
/// order it is what Apply() does.
class OpenChain {
 public:
  explicit OpenChain(const Graph& graph);

  void Apply(const GraphStep& step, Graph* graph) const;

 private:
  struct Sight {
    RunIndex run;
    FrameIndex frame;
  };
  IndexedVector<ModeIndex, Sight> sights_;  // In the middle of those that see the mode.
};

}  // namespace shiftmap
