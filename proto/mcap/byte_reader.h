// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <concepts>
#include <cstddef>
#include <cstdint>
#include <string_view>

namespace shiftmap::mcap {

/// Takes little-endian values off the front of a byte string. Reading past the end gives 0 or an
/// empty string and makes ok() false for good, so that a caller checks once, after the last field.
///
/// Ownership: a view; the bytes must outlive the reader and the strings it returns.
class ByteReader {
 public:
  explicit ByteReader(std::string_view bytes) : rest_(bytes) {}

  template <std::unsigned_integral Number>
  Number Read() {
    const std::string_view bytes = Bytes(sizeof(Number));
    Number value = 0;
    for (std::size_t i = 0; i < bytes.size(); ++i) {
      value =
          static_cast<Number>(value | (Number{static_cast<unsigned char>(bytes[i])} << (8 * i)));
    }
    return value;
  }

  std::string_view Bytes(std::uint64_t count) {
    if (count > rest_.size()) {
      ok_ = false;
      rest_ = {};
      return {};
    }
    const std::string_view bytes = rest_.substr(0, static_cast<std::size_t>(count));
    rest_.remove_prefix(bytes.size());
    return bytes;
  }

  /// A string with its length in 4 bytes before it.
  std::string_view String() { return Bytes(Read<std::uint32_t>()); }

  std::string_view rest() const { return rest_; }
  bool ok() const { return ok_; }

 private:
  std::string_view rest_;
  bool ok_ = true;
};

}  // namespace shiftmap::mcap
