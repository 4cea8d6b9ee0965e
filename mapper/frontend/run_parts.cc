// SPDX-License-Identifier: Apache-2.0
#include "mapper/frontend/run_parts.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <iterator>
#include <optional>

#include "proto/core/check.h"

namespace shiftmap {
namespace {

// Odometry before and after the key frames of a part: more than it ever lags. [s]
constexpr double kOdometryMargin = 1.0;

std::vector<OdometrySample> OdometryBetween(const std::vector<OdometrySample>& odometry,
                                            Stamp begin,
                                            Stamp end) {
  const auto before = [](const OdometrySample& sample, Stamp stamp) {
    return sample.stamp < stamp;
  };
  const Duration margin = FromSeconds(kOdometryMargin);
  auto first = std::lower_bound(odometry.begin(), odometry.end(), begin - margin, before);
  if (first != odometry.begin()) --first;
  auto last = std::lower_bound(first, odometry.end(), end + margin, before);
  if (last != odometry.end()) ++last;
  return {first, last};
}

// Adds where parts of key frames [first, last) begin. Each has a key frame.
void AddPartStarts(const MappingRun& run,
                   double part_s,
                   IndexRange<FrameIndex> frames,
                   std::vector<FrameIndex>* starts) {
  const Stamp begin = run.frames[frames.first].stamp;
  const double duration = ToSeconds(run.frames[frames.last - 1].stamp - begin);
  const double parts = std::max(1.0, std::round(duration / part_s));
  double part = -1.0;
  for (const FrameIndex i : frames) {
    const double at =
        std::floor(parts * ToSeconds(run.frames[i].stamp - begin) / std::max(duration, 1e-9));
    if (std::min(at, parts - 1.0) == part) continue;
    part = std::min(at, parts - 1.0);
    starts->push_back(i);
  }
}

}  // namespace

MappingRun PartOf(const MappingRun& run, FrameIndex first, FrameIndex last) {
  SHIFTMAP_CHECK(0 <= first && first < last && last <= run.frames.end_index(),
                 "key frames {} to {} of {}",
                 first.value(),
                 last.value(),
                 run.frames.size());
  MappingRun part;
  part.name = run.name;
  part.sha256 = run.sha256;
  part.info = run.info;
  part.mean_squared_bearing = run.mean_squared_bearing;
  part.frames.assign(run.frames.begin() + first.value(), run.frames.begin() + last.value());
  const Stamp begin = part.frames.front().stamp;
  const Stamp end = part.frames.back().stamp;
  part.odometry = OdometryBetween(run.odometry, begin, end);
  part.smooth_odometry = OdometryBetween(run.smooth_odometry, begin, end);
  part.begin = std::min(begin, part.odometry.front().stamp);
  part.end = std::max(end, part.odometry.back().stamp);
  std::copy_if(run.scan_stamps.begin(),
               run.scan_stamps.end(),
               std::back_inserter(part.scan_stamps),
               [&](Stamp stamp) { return begin <= stamp && stamp <= end; });

  IndexedVector<VisitIndex, std::optional<VisitIndex>> visit_of(run.visits.size());  // In the part.
  for (KeyFrame& frame : part.frames) {
    const auto sightings = frame.sightings();
    frame.first_sighting = part.sightings.end_index();
    for (const SightingIndex s : sightings) {
      Sighting sighting = run.sightings[s];
      std::optional<VisitIndex>& visit = visit_of[sighting.visit];
      if (!visit) {
        visit = part.visits.end_index();
        const GroupIndex group = run.visits[sighting.visit].group;
        part.visits.push_back({group, frame.stamp, frame.stamp, {}});
      }
      sighting.frame = FrameIndex(sighting.frame - first);
      sighting.visit = *visit;
      MappingVisit& of_part = part.visits[*visit];
      of_part.end = frame.stamp;
      of_part.sightings.push_back(part.sightings.end_index());
      part.sightings.push_back(std::move(sighting));
    }
  }
  return part;
}

RunParts::RunParts(const MappingRun& run, double part_s, const std::vector<FrameIndex>& broken) {
  std::vector<FrameIndex> starts;
  FrameIndex first;
  for (const FrameIndex motion : broken) {
    AddPartStarts(run, part_s, {first, motion + 1}, &starts);
    first = motion + 1;
  }
  AddPartStarts(run, part_s, {first, run.frames.end_index()}, &starts);
  for (std::size_t k = 0; k < starts.size(); ++k) {
    const bool last = k + 1 == starts.size();
    parts_.push_back(PartOf(run, starts[k], last ? run.frames.end_index() : starts[k + 1]));
  }
  poses_.resize(parts_.size());
}

IndexedVector<FrameIndex, Se2> RunParts::Poses(const FrameMotions& motions) const {
  IndexedVector<FrameIndex, Se2> poses = DeadReckon(motions);
  IndexedVector<FrameIndex, bool> known(poses.size());
  FrameIndex begin;
  for (std::size_t k = 0; k < parts_.size(); ++k) {
    FrameIndex i = begin;
    for (const Se2& pose : poses_[k]) {
      poses[i] = pose;
      known[i++] = true;
    }
    begin = begin + parts_[k].frames.end_index().value();
  }
  const auto motion = [&](FrameIndex i) { return motions.between_frames[i].T_begin_end; };
  const FrameIndex first(std::find(known.begin(), known.end(), true) - known.begin());
  if (first == known.end_index()) return poses;
  for (FrameIndex i = first; i > 0; i = i - 1) poses[i - 1] = poses[i] * motion(i - 1).Inverse();
  for (FrameIndex i = first + 1; i < poses.end_index(); ++i) {
    if (!known[i]) poses[i] = poses[i - 1] * motion(i - 1);
  }
  return poses;
}

}  // namespace shiftmap
