// SPDX-License-Identifier: Apache-2.0
#include "mapper/frontend/mapping_run.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "proto/core/check.h"

namespace shiftmap {
namespace {

// The sightings of a scan that can be used: identified, not too near, and each signature at one
// place only.
std::vector<Observation> UsableObservations(const Scan& scan,
                                            const FrontEndOptions& options,
                                            MappingRun* out) {
  std::map<Signature, std::vector<const Observation*>> by_signature;
  for (const Observation& observation : scan.observations) {
    if (observation.signature.anonymous()) {
      ++out->anonymous_observations;
    } else if (observation.kind == Observation::Kind::kRangeBearing &&
               observation.z.x() < options.min_range_m) {
      ++out->near_observations;
    } else {
      by_signature[observation.signature].push_back(&observation);
    }
  }
  std::vector<Observation> usable;
  for (const auto& [signature, observations] : by_signature) {
    const Eigen::Vector2d first = observations.front()->PositionInVehicle();
    const bool one_place =
        std::all_of(observations.begin(), observations.end(), [&](const Observation* other) {
          return (other->PositionInVehicle() - first).norm() <= options.duplicate_distance_m;
        });
    if (one_place) {
      usable.push_back(*observations.front());
    } else {
      out->duplicate_observations += static_cast<int>(observations.size());
    }
  }
  return usable;
}

void AddFrame(Stamp stamp, std::vector<Observation> observations, MappingRun* out) {
  // Scans with one stamp are one key frame: there is no motion between them.
  if (out->frames.empty() || out->frames.back().stamp != stamp) {
    out->frames.push_back({stamp, static_cast<int>(out->sightings.size()), 0});
  }
  const int frame = static_cast<int>(out->frames.size()) - 1;
  for (Observation& observation : observations) {
    out->sightings.push_back({frame, 0, std::move(observation)});
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
  for (const Scan& scan : run.scans) {
    out.scan_stamps.push_back(scan.stamp);
    std::vector<Observation> usable = UsableObservations(scan, options, &out);
    if (!usable.empty()) AddFrame(scan.stamp, std::move(usable), &out);
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
