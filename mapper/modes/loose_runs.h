// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapper/problem/map_problem.h"

namespace shiftmap {

/// Modes that hold a run in the map: one would leave it free to turn about it.
inline constexpr int kMinTyingModes = 2;

/// Why a run that fewer hold is rejected.
inline constexpr char kLooseReason[] = "too few landmarks stand where the map has them";

/// Takes out runs that nothing ties to the others: selection has left too few of their landmarks
/// where the map has them, and a graph with them is not determined. A run is tied by kMinTyingModes
/// that the prior map or runs tied before have; without a prior map the most runs that are tied to
/// each other stay. Modes that no other run has go with them. What is taken out is added to
/// MapProblem::loose. Returns how many runs that are.
int TakeOutLooseRuns(MapProblem* problem);

}  // namespace shiftmap
