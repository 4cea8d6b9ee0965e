// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <functional>

namespace shiftmap {

/// Calls `body` with 0 to count - 1, each once, on up to `threads` threads, and returns when all
/// are done. The result is independent of the threads if each call reads what no other writes and
/// writes to a place of its own. `body` must not throw.
void ForEachIndex(std::size_t count, int threads, const std::function<void(std::size_t)>& body);

}  // namespace shiftmap
