// SPDX-License-Identifier: Apache-2.0
#include "localizer/models/own_field_of_view.h"

#include <cmath>

namespace shiftmap {
namespace {

// One in so many is read as beyond the field of view: the tail of the noise.
constexpr std::int64_t kOneInBeyond = 100;

}  // namespace

OwnFieldOfView::OwnFieldOfView(const SensorCalibration& sensor)
    : own_(sensor), ranges_(sensor.max_range_m), bearings_(sensor.max_bearing_rad) {
  own_.max_range_m = 0.0;
  own_.max_bearing_rad = 0.0;
}

OwnFieldOfView OwnFieldOfView::Whole(const SensorCalibration& sensor) {
  OwnFieldOfView whole(sensor);
  whole.own_ = sensor;
  whole.whole_ = true;
  whole.learns_ = false;
  return whole;
}

void OwnFieldOfView::Add(const Eigen::Vector2d& q) {
  if (!learns_) return;
  ++seen_;
  ranges_.Add(q.norm());
  bearings_.Add(std::abs(std::atan2(q.y(), q.x())));
  const std::int64_t beyond = seen_ / kOneInBeyond;
  own_.max_range_m = ranges_.AllBut(beyond);
  own_.max_bearing_rad = bearings_.AllBut(beyond);
  whole_ = own_.max_range_m == ranges_.limit() && own_.max_bearing_rad == bearings_.limit();
}

void OwnFieldOfView::Histogram::Add(double value) {
  const double bin = value / limit_ * static_cast<double>(kBins);
  const double last = static_cast<double>(kBins - 1);
  ++counts_[bin < last ? static_cast<std::size_t>(bin) : kBins - 1];
}

double OwnFieldOfView::Histogram::AllBut(std::int64_t count) const {
  std::size_t bins = kBins;
  for (std::int64_t beyond = 0; bins > 0; --bins) {
    beyond += counts_[bins - 1];
    if (beyond > count) break;
  }
  return bins == kBins ? limit_ : limit_ * static_cast<double>(bins) / static_cast<double>(kBins);
}

}  // namespace shiftmap
