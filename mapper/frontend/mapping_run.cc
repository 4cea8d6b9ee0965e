// SPDX-License-Identifier: Apache-2.0
#include "mapper/frontend/mapping_run.h"

#include <algorithm>
#include <cmath>
#include <set>

#include "proto/core/check.h"

namespace shiftmap {
namespace {

void AddFrame(const Scan& scan, const std::vector<int>& sighted, MappingRun* out) {
  // Scans with one stamp are one key frame: there is no motion between them.
  if (out->frames.empty() || out->frames.back().stamp != scan.stamp) {
    out->frames.push_back({scan.stamp, static_cast<int>(out->sightings.size()), 0});
  }
  const int frame = static_cast<int>(out->frames.size()) - 1;
  for (const int index : sighted) {
    out->sightings.push_back({frame, 0, scan.observations[static_cast<std::size_t>(index)]});
    ++out->frames.back().sighting_count;
  }
}

void FindVisits(const std::vector<Signature>& signatures, double visit_gap_s, MappingRun* out) {
  const Duration gap = FromSeconds(visit_gap_s);
  std::vector<int> open(signatures.size(), -1);
  for (std::size_t i = 0; i < out->sightings.size(); ++i) {
    Sighting& sighting = out->sightings[i];
    const Stamp stamp = out->frames[static_cast<std::size_t>(sighting.frame)].stamp;
    const auto found =
        std::lower_bound(signatures.begin(), signatures.end(), sighting.observation.signature);
    SHIFTMAP_CHECK(found != signatures.end() && *found == sighting.observation.signature,
                   "signature '{}' is not in the list",
                   sighting.observation.signature.text());
    const auto group = static_cast<std::size_t>(found - signatures.begin());
    if (open[group] < 0 || stamp - out->visits[static_cast<std::size_t>(open[group])].end > gap) {
      open[group] = static_cast<int>(out->visits.size());
      out->visits.push_back({static_cast<int>(group), stamp, stamp, {}});
    }
    sighting.visit = open[group];
    MappingVisit& visit = out->visits[static_cast<std::size_t>(open[group])];
    visit.end = stamp;
    visit.sightings.push_back(static_cast<int>(i));
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
