// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "mapper/frontend/usable_sightings.h"
#include "mapstore/core/ids.h"
#include "mapstore/core/stamp.h"
#include "mapstore/run/run.h"

namespace shiftmap {

/// One landmark seen in one key frame.
struct Sighting {
  int frame = 0;  ///< Index in MappingRun::frames.
  int visit = 0;  ///< Index in MappingRun::visits.
  Observation observation;
};

/// A scan of a run in which an identified landmark was seen: where the mapper estimates the pose.
struct KeyFrame {
  Stamp stamp;
  int first_sighting = 0;  ///< Sightings [first, first + count) were made here.
  int sighting_count = 0;
};

/// One maximal stretch of a run in which a group is seen again and again. The landmark does not
/// change mode inside it.
struct MappingVisit {
  int group = 0;  ///< Index in the sorted list of all signatures of the build.
  Stamp begin;
  Stamp end;
  std::vector<int> sightings;  ///< In the order of time.
};

/// A run, arranged for mapping.
struct MappingRun {
  std::string name;    ///< The log file's stem.
  std::string sha256;  ///< Of the log file.
  RunInfo info;
  std::vector<OdometrySample> odometry;
  std::vector<Stamp> scan_stamps;  ///< Of every scan, also of those without identified landmarks.
  std::vector<KeyFrame> frames;
  std::vector<Sighting> sightings;   ///< By frame.
  std::vector<MappingVisit> visits;  ///< By begin.

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

/// Arranges a valid run for mapping. The run may have no sighting at all.
/// @param signatures  Ascending, holding every signature of the run.
MappingRun MakeMappingRun(const Run& run,
                          const std::vector<Signature>& signatures,
                          const FrontEndOptions& options);

}  // namespace shiftmap
