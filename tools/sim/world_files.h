// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "proto/core/status.h"
#include "tools/sim/simulated_world.h"

namespace shiftmap {

/// Writes a world into a folder, which is made if it does not exist. Per run: run_000.mcap;
/// run_000.truth.tum, the true trajectory; run_000.places.csv (signature,mode,x_m,y_m), where each
/// landmark stood. For the world: truth.csv, the same columns, every place of every landmark;
/// modes.csv (run,signature,mode), which of them held, 0 for none.
/// Returns the paths of the run logs. Errors: as WriteRunLog and AtomicFile.
StatusOr<std::vector<std::string>> WriteWorld(const SimulatedWorld& world,
                                              const std::string& directory);

}  // namespace shiftmap
