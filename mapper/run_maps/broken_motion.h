// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>

#include "mapper/state/build_state.h"

namespace shiftmap {

/// Where the vehicle of a run was moved and its odometry did not see it: it was carried or towed,
/// or drove while the recorder paused. All landmarks that are seen before and after have another
/// position after it, then: `kLeastMoved` at least, and four times as many as stay.
/// @param build  One run, mapped by itself.
/// @return  The motion from which key frame to the next.
std::optional<FrameIndex> FindBrokenMotion(const BuildState& build);

inline constexpr int kLeastMoved = 6;

}  // namespace shiftmap
