// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <concepts>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

#include "proto/core/check.h"
#include "proto/mcap/format.h"

namespace shiftmap::mcap {

/// Appends little-endian values to a byte string.
class ByteWriter {
 public:
  template <std::unsigned_integral Number>
  ByteWriter& Write(Number value) {
    for (std::size_t i = 0; i < sizeof(Number); ++i) {
      bytes_.push_back(static_cast<char>(static_cast<unsigned char>((value >> (8 * i)) & 0xff)));
    }
    return *this;
  }

  ByteWriter& Bytes(std::string_view bytes) {
    bytes_.append(bytes);
    return *this;
  }

  /// A string with its length in 4 bytes before it.
  ByteWriter& String(std::string_view text) {
    SHIFTMAP_CHECK(text.size() <= UINT32_MAX, "string of {} bytes", text.size());
    return Write(static_cast<std::uint32_t>(text.size())).Bytes(text);
  }

  /// A whole record: opcode, length, content.
  ByteWriter& Record(Opcode opcode, std::string_view content) {
    return Write(static_cast<std::uint8_t>(opcode))
        .Write(static_cast<std::uint64_t>(content.size()))
        .Bytes(content);
  }

  const std::string& bytes() const { return bytes_; }
  std::uint64_t size() const { return bytes_.size(); }
  void Clear() { bytes_.clear(); }

 private:
  std::string bytes_;
};

}  // namespace shiftmap::mcap
