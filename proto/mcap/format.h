// SPDX-License-Identifier: Apache-2.0
//
// Constants of the MCAP container (https://mcap.dev/spec, version 0).
//
//   file    = magic, header, data section, data end, summary section, summary offsets, footer,
//   magic record  = opcode (1 byte), content length (8 bytes), content string  = length (4 bytes),
//   UTF-8 bytes
//
// Numbers are little-endian.
#pragma once

#include <cstdint>
#include <string_view>

namespace shiftmap::mcap {

inline constexpr std::string_view kMagic("\x89MCAP0\r\n", 8);

/// Records other than these are skipped, except 0, which is never valid.
enum class Opcode : std::uint8_t {
  kInvalid = 0x00,
  kHeader = 0x01,
  kFooter = 0x02,
  kSchema = 0x03,
  kChannel = 0x04,
  kMessage = 0x05,
  kChunk = 0x06,
  kMessageIndex = 0x07,
  kChunkIndex = 0x08,
  kAttachment = 0x09,
  kAttachmentIndex = 0x0A,
  kStatistics = 0x0B,
  kMetadata = 0x0C,
  kMetadataIndex = 0x0D,
  kSummaryOffset = 0x0E,
  kDataEnd = 0x0F,
};

/// Opcode and content length.
inline constexpr std::uint64_t kRecordHeadBytes = 1 + 8;

/// Content of the footer: summary start, summary offset start, summary CRC.
inline constexpr std::uint64_t kFooterBytes = 8 + 8 + 4;

/// What a reader accepts, so that a hostile file cannot exhaust memory or time. The writer stays
/// within.
inline constexpr std::uint64_t kMaxChunkBytes = std::uint64_t{64} << 20;  ///< Uncompressed.
inline constexpr std::uint64_t kMaxRecordBytes =
    kMaxChunkBytes + (1 << 16);  ///< Content of any record that is not skipped.
inline constexpr std::uint64_t kMaxDefinitionBytes =
    std::uint64_t{64} << 20;  ///< Names and texts of all schemas and channels together.

/// What all chunks may hold together before compression: the first, and the second for each byte of
/// the file up to there. A log of a parked vehicle in chunks of a second holds 3 bytes per byte.
inline constexpr std::uint64_t kFreeExpansionBytes = std::uint64_t{64} << 20;
inline constexpr std::uint64_t kMaxExpansion = 100;

}  // namespace shiftmap::mcap
