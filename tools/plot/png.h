// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "proto/core/status.h"

namespace shiftmap {

/// The width of a PNG in pixels, at most.
inline constexpr int kMaxPngWidthPx = 20000;

/// A picture as a PNG file, drawn from SVG text.
/// @param width_px  In [1, kMaxPngWidthPx]; the height follows. Nothing: twice that of the SVG.
/// Errors: kInvalidArgument if the text is not SVG with a size, or the picture would have more than
/// 4e8 pixels or a height above 32000; kInternal if it cannot be drawn.
StatusOr<std::string> RenderPng(const std::string& svg,
                                std::optional<std::int64_t> width_px = std::nullopt);

}  // namespace shiftmap
