// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

namespace shiftmap {

/// What the localizer says about itself; exclusive.
enum class LocalizerState {
  kInitializing,   ///< No pose yet.
  kTracking,       ///< Pose and map agree.
  kModeChanged,    ///< A known mode took over: the map already knew this.
  kUnknownChange,  ///< A landmark is where no mode is: the map is old there.
  kLost,           ///< The pose itself is not trusted.
};

inline constexpr std::size_t kLocalizerStates = 5;

/// As in JSON, e.g. "MODE_CHANGED".
inline const char* ToString(LocalizerState state) {
  switch (state) {
    case LocalizerState::kInitializing:
      return "INITIALIZING";
    case LocalizerState::kTracking:
      return "TRACKING";
    case LocalizerState::kModeChanged:
      return "MODE_CHANGED";
    case LocalizerState::kUnknownChange:
      return "UNKNOWN_CHANGE";
    case LocalizerState::kLost:
      return "LOST";
  }
  return "";
}

}  // namespace shiftmap
