// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapper/map_problem.h"

namespace shiftmap {

/// Takes out runs that nothing ties to the others: selection has left too few of their landmarks
/// where the map has them, and a graph with them is not determined. A run is tied by two modes that
/// the prior map or runs tied before have; without a prior map the most runs that are tied to each
/// other stay. Modes that no other run has go with them. What is taken out is added to
/// MapProblem::loose. Returns how many runs that are.
int TakeOutLooseRuns(MapProblem* problem);

}  // namespace shiftmap
