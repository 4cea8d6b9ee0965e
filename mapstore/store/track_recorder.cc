// SPDX-License-Identifier: Apache-2.0
#include "mapstore/store/track_recorder.h"

#include <algorithm>
#include <utility>

namespace shiftmap {
namespace {

constexpr double kTolerance = 2e-4;
constexpr std::size_t kLooks = 400;

}  // namespace

TrackRecorder::TrackRecorder(const MapContent& content,
                             Stamp since,
                             std::size_t visits,
                             const LedgerFilter& filter)
    : content_(&content),
      since_(since),
      visits_between_looks_(std::max<std::size_t>(1, visits / kLooks)),
      filter_(&filter) {
  // Without evidence the map's own hold until its stamp.
  for (const LandmarkGroup& group : content.groups) {
    points_.push_back({{Stamp::min(), content.stamp, group.probabilities}});
  }
}

void TrackRecorder::Add(std::size_t group,
                        Stamp begin,
                        Stamp end,
                        const Eigen::VectorXd& probabilities) {
  std::vector<TrackPoint>& points = points_[group];
  const TrackPoint& last = points.back();
  const ModeChain& chain = content_->groups[group].chain;
  // Whoever draws the track has the rates of all hours together.
  const Eigen::VectorXd expected = chain.Propagate(last.probabilities, end - last.end);
  if ((expected - probabilities).cwiseAbs().maxCoeff() <= kTolerance) return;
  if (begin < since_) points.pop_back();
  points.push_back({begin, end, probabilities});
}

void TrackRecorder::Take(const FilteredVisit& visit) {
  Add(visit.group, visit.begin, visit.end, visit.probabilities);
  if (visit.begin < since_) return;
  const bool first = visits_++ == 0;
  if (!first && visits_ % visits_between_looks_ != 0) return;
  if (first || !(filter_->states().records == records_)) TakeAll(visit.begin);
}

void TrackRecorder::TakeAll(Stamp at) {
  records_ = filter_->states().records;
  for (std::size_t group = 0; group < points_.size(); ++group) {
    const Stamp end = std::max(at, points_[group].back().end);
    Add(group, at, end, filter_->ProbabilitiesOf(group, end));
  }
}

std::vector<std::vector<TrackPoint>> TrackRecorder::TakePoints() { return std::move(points_); }

}  // namespace shiftmap
