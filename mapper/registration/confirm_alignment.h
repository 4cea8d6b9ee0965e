// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>

#include "mapper/alignment/explain_alignment.h"
#include "mapper/mapper_options.h"
#include "mapper/run_maps/run_map.h"
#include "mapper/state/build_state.h"
#include "mapstore/map/map_snapshot.h"

namespace shiftmap {

/// The place of a run map by a consensus, and whether it can be trusted.
///
/// All arguments must outlive it.
class ConsensusPlace {
 public:
  /// @param reference  Modes of the map.
  /// @param area_m2    That the map takes. [m²]
  /// @param consensus  Nothing if there is none.
  ConsensusPlace(const MapperOptions& options,
                 const AlignmentPoints& reference,
                 double area_m2,
                 const RunMap& run_map,
                 const std::optional<Alignment>& consensus);

  /// Whether more than few landmarks agree (ConfirmationOptions). Those of one body count as one: a
  /// rack that was moved agrees with itself.
  bool most_agree() const { return most_agree_; }

  /// Whether another place may explain the run map as well: few landmarks agree, or others agree at
  /// another place. Of a run map that is not stiff (IsStiff) the latter says nothing: it differs
  /// from the map by more than its covariance knows.
  bool NeedsConfirmation() const;

  /// Whether another alignment is about this place (ExplanationLimits::same_frame_m).
  bool Is(const Alignment& other) const;

  /// Whether the likeliest explanation is so probable that it is decided for (ConfirmationOptions).
  bool Decides(const Explanation& best) const;

 private:
  bool MostAgree() const;

  const MapperOptions& options_;
  const AlignmentPoints& reference_;
  double area_m2_;
  const RunMap& run_map_;
  const std::optional<Alignment>& consensus_;
  bool most_agree_;
};

/// Where a run map lies in the map, by the joint covariances of both (Explain). A map that is
/// solved from runs has the variance factor that these show, and so has the run map; of a prior
/// map, whose residuals are not kept, it is taken to be that of the run map.
///
/// Match::reference of what stayed is the flat index of a mode of `build`, Match::other that of a
/// point of the run map. Nothing is returned for more than ConfirmationOptions::max_modes modes of
/// its landmarks.
/// @param prior    The map that the build started from.
/// @param build  The map so far, with the modes of `prior`.
/// @param area_m2  That the map takes. [m²]
std::optional<Explanations> ExplainRunMap(const MapperOptions& options,
                                          const std::optional<MapContent>& prior,
                                          const BuildState& build,
                                          double area_m2,
                                          const RunMap& run_map);

}  // namespace shiftmap
