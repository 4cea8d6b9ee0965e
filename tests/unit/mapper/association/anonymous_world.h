// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "mapper/association/anonymous_tracks.h"
#include "mapstore/run/run.h"

namespace shiftmap::testing {

/// A simulated run whose observations lost their signatures, and what they were.
struct AnonymousRun {
  Run run;
  std::vector<std::vector<Signature>> truth;  ///< [scan][observation]; empty for clutter.
};

/// Takes the signatures from a run, except those in `keep`, and adds clutter that is uniform within
/// 8 m before the vehicle.
AnonymousRun Anonymize(const Run& run,
                       const std::vector<Signature>& keep,
                       double clutter_per_scan,
                       std::uint64_t seed);

/// How well tracks and landmarks agree; a track counts for the landmark that most of it is of.
struct AssociationScore {
  double precision = 0.0;  ///< Of observations with a track, those of the track's landmark.
  double recall = 0.0;     ///< Of anonymous observations of landmarks, those in such a track.
  int tracks = 0;
  int landmarks = 0;  ///< Anonymous ones with as many sightings as a track needs.
};
AssociationScore Score(const AnonymousRun& truth,
                       const AnonymousAssociation& found,
                       const AssociationOptions& options);

}  // namespace shiftmap::testing
