// SPDX-License-Identifier: Apache-2.0
#include "mapper/frontend/run_parts.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <iterator>

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
void AddPartStarts(
    const MappingRun& run, double part_s, int first, int last, std::vector<int>* starts) {
  const auto stamp = [&](int i) { return run.frames[static_cast<std::size_t>(i)].stamp; };
  const double duration = ToSeconds(stamp(last - 1) - stamp(first));
  const double parts = std::max(1.0, std::round(duration / part_s));
  double part = -1.0;
  for (int i = first; i < last; ++i) {
    const double at =
        std::floor(parts * ToSeconds(stamp(i) - stamp(first)) / std::max(duration, 1e-9));
    if (std::min(at, parts - 1.0) == part) continue;
    part = std::min(at, parts - 1.0);
    starts->push_back(i);
  }
}

}  // namespace

MappingRun PartOf(const MappingRun& run, int first, int last) {
  SHIFTMAP_CHECK(0 <= first && first < last && last <= std::ssize(run.frames),
                 "key frames {} to {} of {}",
                 first,
                 last,
                 run.frames.size());
  MappingRun part;
  part.name = run.name;
  part.sha256 = run.sha256;
  part.info = run.info;
  part.mean_squared_bearing = run.mean_squared_bearing;
  part.frames.assign(run.frames.begin() + first, run.frames.begin() + last);
  const Stamp begin = part.frames.front().stamp;
  const Stamp end = part.frames.back().stamp;
  part.odometry = OdometryBetween(run.odometry, begin, end);
  part.begin = std::min(begin, part.odometry.front().stamp);
  part.end = std::max(end, part.odometry.back().stamp);
  std::copy_if(run.scan_stamps.begin(),
               run.scan_stamps.end(),
               std::back_inserter(part.scan_stamps),
               [&](Stamp stamp) { return begin <= stamp && stamp <= end; });

  std::vector<int> visit_of(run.visits.size(), -1);  // In the part.
  for (KeyFrame& frame : part.frames) {
    const int from = frame.first_sighting;
    frame.first_sighting = static_cast<int>(part.sightings.size());
    for (int s = from; s < from + frame.sighting_count; ++s) {
      Sighting sighting = run.sightings[static_cast<std::size_t>(s)];
      int& visit = visit_of[static_cast<std::size_t>(sighting.visit)];
      if (visit < 0) {
        visit = static_cast<int>(part.visits.size());
        const int group = run.visits[static_cast<std::size_t>(sighting.visit)].group;
        part.visits.push_back({group, frame.stamp, frame.stamp, {}});
      }
      sighting.frame -= first;
      sighting.visit = visit;
      MappingVisit& of_part = part.visits[static_cast<std::size_t>(visit)];
      of_part.end = frame.stamp;
      of_part.sightings.push_back(static_cast<int>(part.sightings.size()));
      part.sightings.push_back(std::move(sighting));
    }
  }
  return part;
}

RunParts::RunParts(const MappingRun& run, double part_s, const std::vector<std::size_t>& broken) {
  std::vector<int> starts;
  int first = 0;
  for (const std::size_t motion : broken) {
    const int next = static_cast<int>(motion) + 1;
    AddPartStarts(run, part_s, first, next, &starts);
    first = next;
  }
  AddPartStarts(run, part_s, first, static_cast<int>(run.frames.size()), &starts);
  for (std::size_t k = 0; k < starts.size(); ++k) {
    const bool last = k + 1 == starts.size();
    parts_.push_back(
        PartOf(run, starts[k], last ? static_cast<int>(run.frames.size()) : starts[k + 1]));
  }
  poses_.resize(parts_.size());
}

std::vector<Se2> RunParts::Poses(const FrameMotions& motions) const {
  std::vector<Se2> poses = DeadReckon(motions);
  std::vector<bool> known(poses.size());
  std::size_t begin = 0;
  for (std::size_t k = 0; k < parts_.size(); ++k) {
    const std::size_t frames = parts_[k].frames.size();
    for (std::size_t i = 0; i < poses_[k].size(); ++i) {
      poses[begin + i] = poses_[k][i];
      known[begin + i] = true;
    }
    begin += frames;
  }
  const auto motion = [&](std::size_t i) { return motions.between_frames[i].T_begin_end; };
  const auto first =
      static_cast<std::size_t>(std::find(known.begin(), known.end(), true) - known.begin());
  if (first == known.size()) return poses;
  for (std::size_t i = first; i-- > 0;) poses[i] = poses[i + 1] * motion(i).Inverse();
  for (std::size_t i = first + 1; i < poses.size(); ++i) {
    if (!known[i]) poses[i] = poses[i - 1] * motion(i - 1);
  }
  return poses;
}

}  // namespace shiftmap
