// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace shiftmap {

/// Without leap seconds, as stamps are. [s]
inline constexpr double kSecondsPerDay = 86'400.0;

}  // namespace shiftmap
