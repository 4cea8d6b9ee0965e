// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <string>
#include <vector>

#include "mapper/frontend/usable_sightings.h"
#include "mapper/index.h"
#include "mapstore/core/ids.h"
#include "mapstore/core/stamp.h"
#include "mapstore/run/run.h"

namespace shiftmap {

/// One landmark seen in one key frame.
struct Sighting {
  FrameIndex frame;
  VisitIndex visit;
  Observation observation;
};

/// A scan of a run in which an identified landmark was seen: where the mapper estimates the pose.
struct KeyFrame {
  Stamp stamp;
  SightingIndex first_sighting;
  int sighting_count = 0;

  /// Those that were made here.
  IndexRange<SightingIndex> sightings() const {
    return {first_sighting, first_sighting + sighting_count};
  }
};

/// One maximal stretch of a run in which a group is seen again and again. The landmark does not
/// change mode inside it.
struct MappingVisit {
  GroupIndex group;
  Stamp begin;
  Stamp end;
  std::vector<SightingIndex> sightings;  ///< In the order of time.
};

/// A run, arranged for mapping.
struct MappingRun {
  std::string name;    ///< The log file's stem.
  std::string sha256;  ///< Of the log file.
  RunInfo info;
  std::vector<OdometrySample> odometry;
  std::vector<OdometrySample> smooth_odometry;  ///< SmoothOdometry() of the whole log.
  std::vector<Stamp> scan_stamps;  ///< Of every scan, also of those without identified landmarks.
  IndexedVector<FrameIndex, KeyFrame> frames;
  IndexedVector<SightingIndex, Sighting> sightings;  ///< By frame.
  IndexedVector<VisitIndex, MappingVisit> visits;    ///< By begin.

  double mean_squared_bearing = 0.0;  ///< Over all sightings, weighted with r². [rad²]

  int anonymous_observations = 0;  ///< Left out.
  int duplicate_observations = 0;  ///< One signature at two places in one scan: both left out.
  int near_observations = 0;       ///< Nearer than min_range_m: left out.

  Stamp begin;  ///< BeginOf() the run.
  Stamp end;    ///< EndOf() it.
};

/// All signatures seen in `runs` and those in `known`, ascending, each once.
std::vector<Signature> CollectSignatures(const std::vector<const Run*>& runs,
                                         const std::vector<Signature>& known);

/// From the first key frame to the last, of which there is one at least. [s]
double DurationOf(const MappingRun& run);

/// Arranges a valid run for mapping, without visits of landmarks that move while they are in view
/// (FindMovingVisits). The run may have no sighting at all.
/// @param signatures  Ascending, holding every signature of the run.
MappingRun MakeMappingRun(const Run& run,
                          const std::vector<Signature>& signatures,
                          const FrontEndOptions& options);

/// Of landmarks that move while they are in view, how many sightings MakeMappingRun() leaves out.
std::map<Signature, int> MovingSightings(const Run& run, const FrontEndOptions& options);

}  // namespace shiftmap
