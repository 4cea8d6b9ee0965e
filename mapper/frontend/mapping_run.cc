// SPDX-License-Identifier: Apache-2.0
#include "mapper/frontend/mapping_run.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <iterator>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "mapper/frontend/moving_visits.h"
#include "mapper/frontend/smooth_odometry.h"
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

namespace {

const Signature& SignatureOf(const MappingVisit& visit, const std::vector<Signature>& signatures) {
  return signatures[static_cast<std::size_t>(visit.group.value())];
}

bool NoneMoves(Stamp /*stamp*/, const Signature& /*signature*/) { return false; }

// @param moving  Whether a sighting is left out because its landmark moves.
MappingRun Arrange(const Run& run,
                   const std::vector<Signature>& signatures,
                   const FrontEndOptions& options,
                   const std::function<bool(Stamp, const Signature&)>& moving) {
  MappingRun out;
  out.info = run.info;
  out.odometry = run.odometry;
  out.begin = BeginOf(run);
  out.end = EndOf(run);
  for (const Scan& scan : run.scans) {
    out.scan_stamps.push_back(scan.stamp);
    UsableSightings usable = FindUsableSightings(scan, options);
    std::erase_if(usable.named, [&](int index) {
      return moving(scan.stamp, scan.observations[static_cast<std::size_t>(index)].signature);
    });
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

}  // namespace

MappingRun MakeMappingRun(const Run& run,
                          const std::vector<Signature>& signatures,
                          const FrontEndOptions& options) {
  MappingRun all = Arrange(run, signatures, options, NoneMoves);
  std::map<Signature, std::map<Stamp, Stamp>> moving;  // Begins and ends of visits.
  for (const VisitIndex v : FindMovingVisits(all, options.moving)) {
    const MappingVisit& visit = all.visits[v];
    moving[SignatureOf(visit, signatures)].emplace(visit.begin, visit.end);
  }
  const auto moves = [&](Stamp stamp, const Signature& signature) {
    const auto visits = moving.find(signature);
    if (visits == moving.end()) return false;
    const auto after = visits->second.upper_bound(stamp);
    return after != visits->second.begin() && stamp <= std::prev(after)->second;
  };
  MappingRun out = moving.empty() ? std::move(all) : Arrange(run, signatures, options, moves);
  out.smooth_odometry = SmoothOdometry(out.odometry);
  return out;
}

std::map<Signature, int> MovingSightings(const Run& run, const FrontEndOptions& options) {
  const std::vector<Signature> signatures = CollectSignatures({&run}, {});
  const MappingRun all = Arrange(run, signatures, options, NoneMoves);
  std::map<Signature, int> moving;
  for (const VisitIndex v : FindMovingVisits(all, options.moving)) {
    const MappingVisit& visit = all.visits[v];
    moving[SignatureOf(visit, signatures)] += static_cast<int>(visit.sightings.size());
  }
  return moving;
}

}  // namespace shiftmap
