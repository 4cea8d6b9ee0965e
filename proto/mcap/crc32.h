// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string_view>

namespace shiftmap::mcap {

/// Incremental CRC-32 as zlib and IEEE 802.3 define it. Of no bytes it is 0, which MCAP reads as
/// "not stated".
class Crc32 {
 public:
  void Update(std::string_view bytes);
  std::uint32_t value() const { return value_; }

  static std::uint32_t Of(std::string_view bytes) {
    Crc32 crc;
    crc.Update(bytes);
    return crc.value();
  }

 private:
  std::uint32_t value_ = 0;
};

}  // namespace shiftmap::mcap
