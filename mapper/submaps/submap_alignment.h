// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "mapper/alignment/consensus.h"
#include "mapper/submaps/submap.h"

namespace shiftmap {

/// Signatures that must agree in a part of a run: where it is bent itself, three do so by accident.
inline constexpr std::size_t kMinPartSignatures = 4;

/// Whether one rigid transform does not hold for a submap as a whole.
bool IsBent(const Submap& submap);

/// Where a submap lies in the map.
struct SubmapAlignment {
  Alignment alignment;  ///< Of the part of the submap that tells it best.
  bool bent = false;    ///< One rigid transform does not hold for the submap as a whole.

  /// Of a place that is confirmed (confirm_alignment.h): per mode, flat, the mode of its group in
  /// the map that it is, or kUnassigned.
  std::optional<std::vector<int>> stayed;

  /// Of a bent submap, where the map has the modes that agree in their own part, or nothing. Per
  /// mode, flat. [m]
  std::vector<std::optional<Eigen::Vector2d>> places;
};

/// Aligns a submap with the modes of a map.
///
/// What a run says of the distance of two landmarks that it saw long after one another may be
/// metres off, and no rigid transform makes such a submap agree with the map. A submap of which a
/// mode is known worse than to half a metre against the others is therefore cut into parts of
/// neighbours, each of which is aligned by itself. At least kMinPartSignatures must agree in one.
///
/// Nothing is returned if no part aligns. Deterministic.
/// @param reference  Modes of the map, at least those of the groups that the submap has.
/// @param area_m2    That the map takes. [m²]
std::optional<SubmapAlignment> AlignSubmap(const std::vector<AlignmentPoint>& reference,
                                           const Submap& submap,
                                           double area_m2,
                                           const AlignmentOptions& options);

}  // namespace shiftmap
