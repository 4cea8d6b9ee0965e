// SPDX-License-Identifier: Apache-2.0
#include "proto/mcap/byte_source.h"

#include <algorithm>
#include <string_view>

namespace shiftmap::mcap {
namespace {

constexpr std::uint64_t kStepBytes = std::uint64_t{1} << 18;

}  // namespace

StatusOr<bool> ByteSource::Read(std::uint64_t count, std::string* out) {
  while (count > 0) {
    const std::size_t filled = out->size();
    const auto wanted = static_cast<std::size_t>(std::min(count, kStepBytes));
    out->resize(filled + wanted);
    in_->read(out->data() + filled, static_cast<std::streamsize>(wanted));
    const auto got = static_cast<std::size_t>(in_->gcount());
    out->resize(filled + got);
    crc_.Update(std::string_view(*out).substr(filled));
    position_ += got;
    count -= got;
    if (in_->bad()) return Unavailable("cannot read on at byte {}", position_);
    if (got < wanted) return false;
  }
  return true;
}

StatusOr<bool> ByteSource::Skip(std::uint64_t count) {
  std::string step;
  while (count > 0) {
    step.clear();
    const std::uint64_t wanted = std::min(count, kStepBytes);
    SHIFTMAP_ASSIGN_OR_RETURN(const bool whole, Read(wanted, &step));
    if (!whole) return false;
    count -= wanted;
  }
  return true;
}

}  // namespace shiftmap::mcap
