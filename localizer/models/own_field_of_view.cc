// SPDX-License-Identifier: Apache-2.0
#include "localizer/models/own_field_of_view.h"

#include <cmath>
#include <numbers>

#include "mapstore/geometry/angle.h"

namespace shiftmap {
namespace {

constexpr double kTurn = 2.0 * std::numbers::pi;

// One in so many is read as beyond the field of view: the tail of the noise.
constexpr int kOneInBeyond = 100;

}  // namespace

void OwnFieldOfView::Add(const Eigen::Vector2d& q) {
  ++seen_;
  const double range = q.norm() / max_range_m_ * static_cast<double>(kRanges);
  ++by_range_[range < static_cast<double>(kRanges - 1) ? static_cast<std::size_t>(range)
                                                       : kRanges - 1];
  const double turn = std::atan2(q.y(), q.x()) / kTurn + 0.5;
  ++by_bearing_[static_cast<std::size_t>(turn * static_cast<double>(kBearings)) % kBearings];
}

Sector OwnFieldOfView::MakeSector() const {
  Sector sector;
  if (seen_ == 0) return sector;
  int beyond = seen_ / kOneInBeyond;
  SetBearings(beyond, &sector);
  std::size_t bins = kRanges;
  for (; bins > 1 && by_range_[bins - 1] <= beyond; --bins) beyond -= by_range_[bins - 1];
  sector.max_range_m = max_range_m_ * static_cast<double>(bins) / static_cast<double>(kRanges);
  return sector;
}

void OwnFieldOfView::SetBearings(int beyond, Sector* sector) const {
  std::size_t longest = 0;
  std::size_t after = 0;  // The bin behind the longest.
  std::size_t length = 0;
  int in_arc = 0;
  for (std::size_t end = 0; end < 2 * kBearings; ++end) {
    in_arc += by_bearing_[end % kBearings];
    ++length;
    while (length > 0 && (in_arc > beyond || length > kBearings)) {
      in_arc -= by_bearing_[(end + 1 - length) % kBearings];
      --length;
    }
    if (length <= longest) continue;
    longest = length;
    after = end + 1;
  }
  constexpr double kStep = kTurn / static_cast<double>(kBearings);
  const double width = kStep * static_cast<double>(kBearings - longest);
  const double begin = kStep * static_cast<double>(after) - std::numbers::pi;
  sector->centre_rad = WrapAngle(begin + 0.5 * width);
  sector->half_width_rad = longest == 0 ? kTurn : 0.5 * (width + kStep);
}

}  // namespace shiftmap
