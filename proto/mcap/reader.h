// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <istream>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "proto/core/status.h"

namespace shiftmap::mcap {

/// What a channel's messages are.
struct Channel {
  std::string topic;
  std::string message_encoding;  ///< E.g. "protobuf".
  std::string schema_name;       ///< E.g. "shiftmap.proto.Odometry"; empty without a schema.
  std::string schema_encoding;   ///< E.g. "protobuf".
  /// The schema's own bytes, in that encoding, shared by its channels; null without a schema.
  std::shared_ptr<const std::string> schema_data;
};

/// One message of a log.
struct LogMessage {
  const Channel* channel = nullptr;  ///< Valid as long as the reader.
  std::uint32_t sequence = 0;
  std::uint64_t log_time_ns = 0;
  std::uint64_t publish_time_ns = 0;
  std::string_view data;  ///< Valid until the next call of Reader::Next().
};

/// Reads the messages of an MCAP file front to back, in the order of the file, without seeking: a
/// pipe will do. Needs memory for one chunk, of at most kMaxChunkBytes, and time in proportion to
/// the file (kMaxExpansion). The input is not trusted: no length in it is believed before the bytes
/// are there, and every CRC it states is checked.
///
/// A file that ends early, as after a power failure, gives everything up to its last whole chunk
/// (or its last whole message outside chunks), and truncation() then says so.
///
/// Errors: kInvalidArgument if it is not MCAP, or a chunk's compression is none of "", "none",
/// "zstd" and "lz4"; kDataLoss if a CRC is wrong, a record does not hold what its type says, or a
/// limit of format.h is passed; kUnavailable if the stream cannot be read. After an error the
/// reader is at its end. Messages name the byte of the record.
class Reader {
 public:
  /// Reads the header.
  /// @param in  Borrowed; must outlive the reader. Opened as binary.
  static StatusOr<Reader> Open(std::istream* in);

  Reader(Reader&&) noexcept;
  Reader& operator=(Reader&&) noexcept;
  ~Reader();

  /// The next message, or nothing at the end.
  StatusOr<std::optional<LogMessage>> Next();

  /// Empty, or where a file that ends early ends. Complete after Next() returned nothing.
  const std::string& truncation() const;

 private:
  class State;
  explicit Reader(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace shiftmap::mcap
