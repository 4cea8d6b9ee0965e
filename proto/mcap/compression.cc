// SPDX-License-Identifier: Apache-2.0
#include "proto/mcap/compression.h"

#include <lz4frame.h>
#include <zstd.h>

#include <algorithm>
#include <functional>
#include <memory>

#include "proto/mcap/format.h"

namespace shiftmap::mcap {
namespace {

constexpr int kZstdLevel = 3;
constexpr std::size_t kGrowthBytes = std::size_t{1} << 18;
constexpr int kMaxWindowLog = 26;
static_assert(std::uint64_t{1} << kMaxWindowLog == kMaxChunkBytes);

struct FreeStream {
  void operator()(ZSTD_DStream* stream) const { ZSTD_freeDStream(stream); }
};

struct FreeContext {
  void operator()(LZ4F_dctx* context) const { LZ4F_freeDecompressionContext(context); }
};

// One step of a decompressor: from `in` to the `room` bytes at `to`.
struct Step {
  std::size_t read = 0;
  std::size_t written = 0;
  bool frame_complete = false;
};
using Decompressor = std::function<StatusOr<Step>(std::string_view in, char* to, std::size_t room)>;

// Lets a decompressor run to the end of `bytes`, which may be several frames.
StatusOr<std::string> Expand(std::string_view name,
                             std::string_view bytes,
                             std::uint64_t size,
                             const Decompressor& decompress) {
  std::string out;
  std::string_view rest = bytes;
  Step step;
  for (bool progress = true; progress;) {
    const std::size_t filled = out.size();
    // One byte above `size`, so that a frame that is too long shows.
    const auto wanted = static_cast<std::size_t>(
        std::min<std::uint64_t>(size + 1 - filled, std::max(filled, kGrowthBytes)));
    out.resize(filled + wanted);
    SHIFTMAP_ASSIGN_OR_RETURN(step, decompress(rest, out.data() + filled, wanted));
    rest.remove_prefix(step.read);
    out.resize(filled + step.written);
    if (out.size() > size) return DataLoss("{}: more than the stated {} bytes", name, size);
    const bool finished = step.frame_complete && rest.empty();
    progress = !finished && (step.written > 0 || step.read > 0);
  }
  if (!step.frame_complete || !rest.empty() || out.size() != size) {
    return DataLoss("{}: {} of {} bytes give {} bytes, expected {}",
                    name,
                    bytes.size() - rest.size(),
                    bytes.size(),
                    out.size(),
                    size);
  }
  return out;
}

StatusOr<std::string> DecompressZstd(std::string_view bytes, std::uint64_t size) {
  const std::unique_ptr<ZSTD_DStream, FreeStream> stream(ZSTD_createDStream());
  if (stream == nullptr) return MakeStatus(StatusCode::kResourceExhausted, "zstd: out of memory");
  // A frame may ask for a buffer of any size; a chunk needs none that is larger than itself.
  ZSTD_DCtx_setParameter(stream.get(), ZSTD_d_windowLogMax, kMaxWindowLog);
  const auto decompress = [&](std::string_view in, char* to, std::size_t room) -> StatusOr<Step> {
    ZSTD_inBuffer input{in.data(), in.size(), 0};
    ZSTD_outBuffer output{to, room, 0};
    const std::size_t hint = ZSTD_decompressStream(stream.get(), &output, &input);
    if (ZSTD_isError(hint) != 0U) return DataLoss("zstd: {}", ZSTD_getErrorName(hint));
    return Step{input.pos, output.pos, hint == 0};
  };
  return Expand("zstd", bytes, size, decompress);
}

StatusOr<std::string> DecompressLz4(std::string_view bytes, std::uint64_t size) {
  LZ4F_dctx* created = nullptr;
  if (LZ4F_isError(LZ4F_createDecompressionContext(&created, LZ4F_VERSION)) != 0U) {
    return MakeStatus(StatusCode::kResourceExhausted, "lz4: out of memory");
  }
  const std::unique_ptr<LZ4F_dctx, FreeContext> context(created);
  const auto decompress = [&](std::string_view in, char* to, std::size_t room) -> StatusOr<Step> {
    std::size_t read = in.size();
    std::size_t written = room;
    const std::size_t hint =
        LZ4F_decompress(context.get(), to, &written, in.data(), &read, nullptr);
    if (LZ4F_isError(hint) != 0U) return DataLoss("lz4: {}", LZ4F_getErrorName(hint));
    return Step{read, written, hint == 0};
  };
  return Expand("lz4", bytes, size, decompress);
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
  if (name == "lz4") return DecompressLz4(bytes, size);
  if (!name.empty() && name != "none") {
    return InvalidArgument("chunk compression '{}', this build reads '', 'zstd' and 'lz4'", name);
  }
  if (bytes.size() != size) return DataLoss("{} bytes, expected {}", bytes.size(), size);
  return std::string(bytes);
}

}  // namespace shiftmap::mcap
