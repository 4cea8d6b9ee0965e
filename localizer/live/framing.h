// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

#include "proto/core/status.h"

namespace shiftmap::live {

/// Longest message on the socket. A scan of a thousand landmarks has about 60 kB. [byte]
inline constexpr std::size_t kMaxFrameBytes = std::size_t{1} << 20;

/// A message with its length before it, as a Protobuf varint.
/// Precondition: at most kMaxFrameBytes.
std::string Framed(std::string_view message);

/// Takes a stream of bytes apart into messages. A length is checked before memory is set aside for
/// it.
class FrameReader {
 public:
  void Append(std::string_view bytes);

  /// The next whole message, or nothing if more bytes are needed.
  /// Errors: kInvalidArgument for a length above kMaxFrameBytes or that is no varint; the stream
  /// cannot be read on from there.
  StatusOr<std::optional<std::string>> Next();

  /// Bytes of a message that has begun.
  std::size_t pending() const { return buffer_.size() - begin_; }

 private:
  std::string buffer_;
  std::size_t begin_ = 0;  // Of what was not taken yet.
};

}  // namespace shiftmap::live
