// SPDX-License-Identifier: Apache-2.0
#include "localizer/filter/unknown_places.h"

#include <algorithm>

namespace shiftmap {

const UnknownPlace* UnknownPlaces::Find(int group) const {
  const auto found = std::find_if(places_.begin(), places_.end(), [&](const UnknownPlace& place) {
    return place.group == group;
  });
  return found == places_.end() ? nullptr : &*found;
}

void UnknownPlaces::Put(const UnknownPlace& place) {
  Erase(place.group);
  if (places_.size() == kMaxPlaces) places_.erase(places_.begin());
  places_.push_back(place);
}

void UnknownPlaces::Erase(int group) {
  const auto found = std::find_if(places_.begin(), places_.end(), [&](const UnknownPlace& place) {
    return place.group == group;
  });
  if (found != places_.end()) places_.erase(found);
}

}  // namespace shiftmap
