// SPDX-License-Identifier: Apache-2.0
#include "mapstore/core/stamp_check.h"

#include <cstdint>

namespace shiftmap {

Status ValidateStamp(Stamp stamp) {
  constexpr Duration kMaxSinceEpoch{std::int64_t{1} << 62};
  const Duration since_epoch = stamp.time_since_epoch();
  if (since_epoch >= -kMaxSinceEpoch && since_epoch < kMaxSinceEpoch) return OkStatus();
  return InvalidArgument("stamp_ns: {}, expected within 146 years of 1970", ToNanoseconds(stamp));
}

}  // namespace shiftmap
