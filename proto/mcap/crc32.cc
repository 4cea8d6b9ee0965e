// SPDX-License-Identifier: Apache-2.0
#include "proto/mcap/crc32.h"

#include <zlib.h>

namespace shiftmap::mcap {

void Crc32::Update(std::string_view bytes) {
  value_ = static_cast<std::uint32_t>(
      crc32_z(value_, reinterpret_cast<const Bytef*>(bytes.data()), bytes.size()));
}

}  // namespace shiftmap::mcap
