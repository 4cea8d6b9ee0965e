// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <string_view>

#include "proto/core/status.h"
#include "proto/mcap/byte_writer.h"
#include "proto/mcap/compression.h"
#include "proto/mcap/crc32.h"

namespace shiftmap::mcap {

struct WriterOptions {
  Compression compression = Compression::kZstd;

  /// Size of a chunk before compression at which it is closed; 0 writes messages without chunks.
  /// A larger chunk compresses better, and a crash loses more. At most kMaxChunkBytes. [byte]
  std::uint64_t chunk_bytes = std::uint64_t{256} << 10;

  /// Log time at which a chunk is closed; 0: none. [ns]
  std::uint64_t chunk_duration_ns = 1'000'000'000;
};

/// Writes an MCAP file front to back: chunks with CRC, then the data CRC, the summary (definitions,
/// statistics) with its offsets and CRC. Schemas and channels stand outside the chunks. Each chunk
/// goes to the sink when it is closed, so that a crash loses the open one only.
///
/// There is no index: readers that seek in a file without a chunk index read it front to back.
///
/// Errors: those of the sink, from every later call too; kInvalidArgument for a message too large
/// for a chunk.
/// Determinism: the same calls give the same bytes, with one version of the zstd library.
class Writer {
 public:
  /// Takes the file's next bytes.
  using Sink = std::function<Status(std::string_view bytes)>;

  Writer(Sink sink, const WriterOptions& options);

  /// Defines a schema; returns its id.
  /// @param encoding  E.g. "protobuf", and `data` then is a FileDescriptorSet.
  std::uint16_t AddSchema(std::string_view name, std::string_view encoding, std::string_view data);

  /// Defines a channel; returns its id.
  std::uint16_t AddChannel(std::uint16_t schema_id,
                           std::string_view topic,
                           std::string_view message_encoding);

  /// Appends a message; its sequence number counts the channel's messages from 0.
  /// @param time_ns  Log and publish time, since the Unix epoch.
  Status Write(std::uint16_t channel_id, std::uint64_t time_ns, std::string_view data);

  /// Closes the last chunk and writes the summary. Call once, last.
  Status Finish();

 private:
  struct ChannelState {
    std::uint32_t sequence = 0;
    std::uint64_t messages = 0;
  };

  void Emit(std::string_view bytes);
  void EmitDefinition(Opcode opcode, std::string_view content, ByteWriter* summary);
  // Whether the open chunk has no room for a record.
  bool IsFull(std::uint64_t record_bytes, std::uint64_t time_ns) const;
  void FlushChunk();
  ByteWriter Statistics() const;

  Sink sink_;
  WriterOptions options_;
  Status status_;
  Crc32 data_crc_;
  std::uint64_t position_ = 0;

  ByteWriter schemas_;  // Whole records, for the summary.
  ByteWriter channels_;
  std::uint16_t schema_count_ = 0;
  std::uint32_t chunk_count_ = 0;
  std::map<std::uint16_t, ChannelState> channel_states_;  // By channel id, from 1.
  std::uint64_t message_count_ = 0;
  std::uint64_t start_ns_ = 0;
  std::uint64_t end_ns_ = 0;

  ByteWriter chunk_;
  std::uint64_t chunk_start_ns_ = 0;
  std::uint64_t chunk_end_ns_ = 0;
};

}  // namespace shiftmap::mcap
