// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <istream>
#include <string>

#include "proto/core/status.h"
#include "proto/mcap/crc32.h"

namespace shiftmap::mcap {

/// Reads a stream front to back, counts its bytes and keeps a CRC over them.
///
/// Ownership: borrows the stream.
class ByteSource {
 public:
  explicit ByteSource(std::istream* in) : in_(in) {}

  /// Appends exactly `count` bytes to `out`; false if the stream ends before, with what there was
  /// appended. Memory grows with what arrives, never with `count` alone.
  /// Errors: kUnavailable if the stream cannot be read.
  StatusOr<bool> Read(std::uint64_t count, std::string* out);

  /// As Read, without keeping the bytes.
  StatusOr<bool> Skip(std::uint64_t count);

  /// Bytes read so far.
  std::uint64_t position() const { return position_; }

  /// Over the bytes since the start or the last ResetCrc().
  std::uint32_t crc() const { return crc_.value(); }
  void ResetCrc() { crc_ = Crc32(); }

 private:
  std::istream* in_;
  std::uint64_t position_ = 0;
  Crc32 crc_;
};

}  // namespace shiftmap::mcap
