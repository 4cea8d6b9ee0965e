// SPDX-License-Identifier: Apache-2.0
#include "mapper/frontend/mapping_run.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <set>

#include "proto/core/check.h"

namespace shiftmap {
namespace {

void AddFrame(const Scan& scan, const std::vector<int>& sighted, MappingRun* out) {
  // Scans with one stamp are one key frame: there is no motion between them.
  if (out->frames.empty() || out->frames.back().stamp != scan.stamp) {
    out->frames.push_back({scan.stamp, out->sightings.end_index(), 0});
  }
  const FrameIndex frame = out->frames.end_index() - 1;
  for (const int index : sighted) {
    out->sightings.push_back({frame, 0, scan.observations[static_cast<std::size_t>(index)]});
    ++out->frames.back().sighting_count;
  }
}

void FindVisits(const std::vector<Signature>& signatures, double visit_gap_s, MappingRun* out) {
  const Duration gap = FromSeconds(visit_gap_s);
  IndexedVector<GroupIndex, std::optional<VisitIndex>> open(signatures.size());
  for (const SightingIndex i : out->sightings.indices()) {
    Sighting& sighting = out->sightings[i];
    const Stamp stamp = out->frames[sighting.frame].stamp;
    const auto found =
        std::lower_bound(signatures.begin(), signatures.end(), sighting.observation.signature);
    SHIFTMAP_CHECK(found != signatures.end() && *found == sighting.observation.signature,
                   "signature '{}' is not in the list",
                   sighting.observation.signature.text());
    const GroupIndex group(found - signatures.begin());
    if (!open[group] || stamp - out->visits[*open[group]].end > gap) {
      open[group] = out->visits.end_index();
      out->visits.push_back({group, stamp, stamp, {}});
    }
    sighting.visit = *open[group];
    MappingVisit& visit = out->visits[sighting.visit];
    visit.end = stamp;
    visit.sightings.push_back(i);
  }
}

}  // namespace

std::vector<Signature> CollectSignatures(const std::vector<const Run*>& runs,
                                         const std::vector<Signature>& known) {
  std::set<Signature> all(known.begin(), known.end());
  for (const Run* run : runs) {
    for (const Scan& scan : run->scans) {
      for (const Observation& observation : scan.observations) {
        if (!observation.signature.anonymous()) all.insert(observation.signature);
      }
    }
  }
  return {all.begin(), all.end()};
}

double DurationOf(const MappingRun& run) {
  return ToSeconds(run.frames.back().stamp - run.frames.front().stamp);
}

MappingRun MakeMappingRun(const Run& run,
                          const std::vector<Signature>& signatures,
                          const FrontEndOptions& options) {
  MappingRun out;
  out.info = run.info;
  out.odometry = run.odometry;
  out.begin = BeginOf(run);
  out.end = EndOf(run);
  for (const Scan& scan : run.scans) {
    out.scan_stamps.push_back(scan.stamp);
    const UsableSightings usable = FindUsableSightings(scan, options);
    out.anonymous_observations += static_cast<int>(usable.anonymous.size());
    out.duplicate_observations += usable.duplicate;
    out.near_observations += usable.near;
    if (!usable.named.empty()) AddFrame(scan, usable.named, &out);
  }
  FindVisits(signatures, options.visit_gap_s, &out);
  double squared_ranges = 0.0;
  for (const Sighting& sighting : out.sightings) {
    const Eigen::Vector2d q = sighting.observation.PositionInVehicle();
    const double bearing = std::atan2(q.y(), q.x());
    squared_ranges += q.squaredNorm();
    out.mean_squared_bearing += bearing * bearing * q.squaredNorm();
  }
  if (squared_ranges > 0.0) out.mean_squared_bearing /= squared_ranges;
  return out;
}

}  // namespace shiftmap
