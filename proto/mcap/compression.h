// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "proto/core/status.h"

namespace shiftmap::mcap {

/// How the records of a chunk are stored.
enum class Compression { kNone, kZstd };

/// The name that a chunk states: "" or "zstd".
std::string_view CompressionName(Compression compression);

/// Compresses a chunk's records. Deterministic for one version of the zstd library.
/// Errors: kResourceExhausted if zstd gets no memory.
StatusOr<std::string> Compress(Compression compression, std::string_view bytes);

/// Undoes a chunk's compression, by the name that the chunk states. Memory grows with what really
/// comes out of `bytes`, never with `size` alone.
/// @param size  Bytes that must come out.
/// Errors: kInvalidArgument for a compression that is not "", "none", "zstd" or "lz4"; kDataLoss if
/// `bytes` are not what that compression makes or another number of bytes comes out;
/// kResourceExhausted if the library gets no memory.
StatusOr<std::string> Decompress(std::string_view name, std::string_view bytes, std::uint64_t size);

}  // namespace shiftmap::mcap
