// SPDX-License-Identifier: Apache-2.0
#include "localizer/live/checked_file.h"

#include <cerrno>
#include <cstring>
#include <fstream>
#include <iterator>

#include "mapstore/core/atomic_file.h"
#include "proto/mcap/crc32.h"

namespace shiftmap::live {
namespace {

// The checksum's line, then the message.
std::string Head(std::string_view kind, std::string_view message) {
  return fmt::format("shiftmap {} {:08x}\n", kind, mcap::Crc32::Of(message));
}

}  // namespace

Status WriteCheckedFile(std::string_view kind, std::string_view message, const std::string& path) {
  return WriteFileAtomically(path, Head(kind, message).append(message));
}

StatusOr<std::string> ReadCheckedFile(std::string_view kind, const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) return NotFound("cannot open: {}", std::strerror(errno));
  const std::string bytes((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
  const std::size_t head = Head(kind, "").size();
  std::string message = bytes.size() < head ? "" : bytes.substr(head);
  if (bytes.size() < head || bytes.substr(0, head) != Head(kind, message)) {
    return DataLoss("checksum mismatch");
  }
  return message;
}

}  // namespace shiftmap::live
