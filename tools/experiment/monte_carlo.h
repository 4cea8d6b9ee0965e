// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>

namespace shiftmap {

/// Calls `body` with 0 to count - 1, each once, on up to `threads` threads. Results are independent
/// of the threads if the body draws from a generator of its own, seeded with its number, and writes
/// to a place of its own. `body` must not throw.
void ForEachRealization(int count, int threads, const std::function<void(int)>& body);

/// Processor time of the calling thread: what it used, however busy the machine is. [s]
double ThreadProcessorSeconds();

}  // namespace shiftmap
