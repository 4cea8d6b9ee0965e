// SPDX-License-Identifier: Apache-2.0
//
// Okabe and Ito's colours, which people tell apart with any colour vision, and the greys of axes
// and notes. Every picture takes its colours from here.
#pragma once

#include <array>
#include <cstddef>

namespace shiftmap::palette {

inline constexpr char kBlue[] = "#0072B2";
inline constexpr char kOrange[] = "#E69F00";
inline constexpr char kGreen[] = "#009E73";
inline constexpr char kPurple[] = "#CC79A7";
inline constexpr char kVermillion[] = "#D55E00";
inline constexpr char kSky[] = "#56B4E9";
inline constexpr char kYellow[] = "#F0E442";

inline constexpr char kInk[] = "#111111";
inline constexpr char kText[] = "#333333";
inline constexpr char kNote[] = "#666666";
inline constexpr char kFaint[] = "#999999";
inline constexpr char kGrid[] = "#E6E6E6";
inline constexpr char kPaper[] = "#FFFFFF";

/// Of runs on a map, whose landmarks are blue.
inline constexpr std::array<const char*, 6> kRuns = {
    kOrange, kGreen, kPurple, kVermillion, kSky, "#B8AA00"};

/// Of the modes of one landmark. `absent` is kFaint.
inline constexpr std::array<const char*, 7> kModes = {
    kBlue, kOrange, kGreen, kVermillion, kPurple, kSky, kYellow};

template <std::size_t Size>
const char* Cycle(const std::array<const char*, Size>& colors, std::size_t index) {
  return colors[index % Size];
}

}  // namespace shiftmap::palette
