// SPDX-License-Identifier: Apache-2.0
#include "proto/mcap/compression.h"

#include <zstd.h>

#include <algorithm>
#include <memory>

#include "proto/mcap/format.h"

namespace shiftmap::mcap {
namespace {

constexpr int kZstdLevel = 3;
constexpr std::size_t kStepBytes = std::size_t{1} << 18;
constexpr int kMaxWindowLog = 26;
static_assert(std::uint64_t{1} << kMaxWindowLog == kMaxChunkBytes);

struct FreeStream {
  void operator()(ZSTD_DStream* stream) const { ZSTD_freeDStream(stream); }
};

StatusOr<std::string> DecompressZstd(std::string_view bytes, std::uint64_t size) {
  const std::unique_ptr<ZSTD_DStream, FreeStream> stream(ZSTD_createDStream());
  if (stream == nullptr) return MakeStatus(StatusCode::kResourceExhausted, "zstd: out of memory");
  // A frame may ask for a buffer of any size; a chunk needs none that is larger than itself.
  ZSTD_DCtx_setParameter(stream.get(), ZSTD_d_windowLogMax, kMaxWindowLog);
  std::string out;
  ZSTD_inBuffer in{bytes.data(), bytes.size(), 0};
  std::size_t hint = 1;  // 0 once a frame is complete.
  bool progress = true;
  while (progress) {
    const std::size_t filled = out.size();
    // One byte above `size`, so that a frame that is too long shows.
    const auto wanted = static_cast<std::size_t>(
        std::min<std::uint64_t>(size + 1 - filled, std::max(filled, kStepBytes)));
    out.resize(filled + wanted);
    ZSTD_outBuffer step{out.data() + filled, wanted, 0};
    const std::size_t consumed = in.pos;
    hint = ZSTD_decompressStream(stream.get(), &step, &in);
    out.resize(filled + step.pos);
    if (ZSTD_isError(hint) != 0U) return DataLoss("zstd: {}", ZSTD_getErrorName(hint));
    if (out.size() > size) return DataLoss("zstd: more than the stated {} bytes", size);
    const bool finished = hint == 0 && in.pos == in.size;
    progress = !finished && (step.pos > 0 || in.pos > consumed);
  }
  if (hint != 0 || in.pos != in.size || out.size() != size) {
    return DataLoss(
        "zstd: {} of {} bytes give {} bytes, expected {}", in.pos, in.size, out.size(), size);
  }
  return out;
}

}  // namespace

std::string_view CompressionName(Compression compression) {
  return compression == Compression::kZstd ? "zstd" : "";
}

StatusOr<std::string> Compress(Compression compression, std::string_view bytes) {
  if (compression == Compression::kNone) return std::string(bytes);
  std::string out(ZSTD_compressBound(bytes.size()), '\0');
  const std::size_t size =
      ZSTD_compress(out.data(), out.size(), bytes.data(), bytes.size(), kZstdLevel);
  if (ZSTD_isError(size) != 0U) {
    return MakeStatus(StatusCode::kResourceExhausted, "zstd: {}", ZSTD_getErrorName(size));
  }
  out.resize(size);
  return out;
}

StatusOr<std::string> Decompress(std::string_view name,
                                 std::string_view bytes,
                                 std::uint64_t size) {
  if (name == "zstd") return DecompressZstd(bytes, size);
  if (!name.empty() && name != "none") {
    return InvalidArgument("chunk compression '{}', this build reads '' and 'zstd'", name);
  }
  if (bytes.size() != size) return DataLoss("{} bytes, expected {}", bytes.size(), size);
  return std::string(bytes);
}

}  // namespace shiftmap::mcap
