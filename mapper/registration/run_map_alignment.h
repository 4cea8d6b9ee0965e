// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <optional>

#include "mapper/alignment/consensus.h"
#include "mapper/alignment/explanation.h"
#include "mapper/registration/mode_match.h"
#include "mapper/run_maps/run_map.h"

namespace shiftmap {

/// Signatures that must agree in a part of a run: where it is deformed itself, three do so by
/// accident.
inline constexpr std::size_t kMinPartSignatures = 4;

/// Whether one rigid transform does not hold for a run map as a whole.
bool IsDeformable(const RunMap& run_map, const AlignmentOptions& options);

/// Where a run map lies in the map.
struct RunMapAlignment {
  Alignment alignment;    ///< Of the part of the run map that tells it best.
  bool deformed = false;  ///< One rigid transform does not hold for the run map as a whole.

  /// Of a place that is confirmed (confirm_alignment.h).
  std::optional<KnownModes> stayed;

  /// Of a place that is confirmed: what may have stayed.
  StayedPosterior given = {};

  /// Of a deformed run map: of the modes that agree in their own part.
  ModePlaces places;
};

/// Aligns a run map with the modes of a map.
///
/// What a run says of the distance of two landmarks that it saw long after one another may be
/// metres off, and no rigid transform makes such a run map agree with the map. One that is
/// IsDeformable() is therefore cut into parts of neighbours, each of which is aligned by itself. At
/// least kMinPartSignatures must agree in one.
///
/// Nothing is returned if no part aligns. Deterministic.
/// @param reference  Modes of the map, at least those of the groups that the run map has.
/// @param area_m2    That the map takes. [m²]
std::optional<RunMapAlignment> AlignRunMap(const AlignmentPoints& reference,
                                           const RunMap& run_map,
                                           double area_m2,
                                           const AlignmentOptions& options);

}  // namespace shiftmap
