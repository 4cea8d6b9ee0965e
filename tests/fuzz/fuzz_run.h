// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "mapstore/geometry/covariance.h"
#include "mapstore/map/map_snapshot.h"
#include "mapstore/run/run.h"
#include "tests/fuzz/fuzz_input.h"

namespace shiftmap::testing {

/// A small map, and what a vehicle sees and drives on it for twenty seconds: what a fuzzer's input
/// edits, so that an extreme meets a localizer that knows where it is.
struct FuzzWorld {
  FuzzWorld();

  MapContent content;
  std::vector<RunEvent> events;  ///< Valid and in order.
};

/// Applies up to 16 edits to items: other numbers, further observations, items lost, repeated or
/// moved in time, an odometer that stays broken. Uses up the input, unless edits are ended by one
/// of a kind of its own.
void EditEvents(FuzzInput* input, std::vector<RunEvent>* events);

/// A pose with a covariance that need not be one.
PoseWithCovariance TakePose(FuzzInput* input);

/// Inputs of EditEvents that set one number of one item to each extreme in turn.
std::vector<std::string> EditSeeds();

}  // namespace shiftmap::testing
