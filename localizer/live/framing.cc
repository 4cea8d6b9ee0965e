// SPDX-License-Identifier: Apache-2.0
#include "localizer/live/framing.h"

#include "proto/core/check.h"

namespace shiftmap::live {
namespace {

// Enough for every length up to kMaxFrameBytes.
constexpr std::size_t kMaxLengthBytes = 3;
constexpr unsigned kVarintBits = 7;
constexpr unsigned char kMore = 0x80;

}  // namespace

std::string Framed(std::string_view message) {
  SHIFTMAP_CHECK(message.size() <= kMaxFrameBytes, "message of {} bytes", message.size());
  std::string framed;
  framed.reserve(message.size() + kMaxLengthBytes);
  std::size_t length = message.size();
  while (length >= kMore) {
    framed.push_back(static_cast<char>((length & (kMore - 1u)) | kMore));
    length >>= kVarintBits;
  }
  framed.push_back(static_cast<char>(length));
  framed.append(message);
  return framed;
}

void FrameReader::Append(std::string_view bytes) {
  // Moved to the front only when that is cheap beside what comes in.
  if (begin_ > 0 && begin_ >= pending()) {
    buffer_.erase(0, begin_);
    begin_ = 0;
  }
  buffer_.append(bytes);
}

StatusOr<std::optional<std::string>> FrameReader::Next() {
  std::size_t length = 0;
  for (std::size_t i = 0; i < kMaxLengthBytes; ++i) {
    if (i == pending()) return std::optional<std::string>();
    const auto byte = static_cast<unsigned char>(buffer_[begin_ + i]);
    length |= static_cast<std::size_t>(byte & (kMore - 1u)) << (kVarintBits * i);
    if ((byte & kMore) != 0) continue;
    if (length > kMaxFrameBytes) break;
    const std::size_t head = i + 1;
    if (pending() < head + length) return std::optional<std::string>();
    std::string message = buffer_.substr(begin_ + head, length);
    begin_ += head + length;
    return std::optional<std::string>(std::move(message));
  }
  return InvalidArgument("message longer than {} bytes", kMaxFrameBytes);
}

}  // namespace shiftmap::live
