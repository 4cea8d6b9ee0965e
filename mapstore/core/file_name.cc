// SPDX-License-Identifier: Apache-2.0
#include "mapstore/core/file_name.h"

#include <fmt/format.h>

#include <cstddef>

#include "mapstore/map/sha256.h"

namespace shiftmap {
namespace {

constexpr std::size_t kMaxBytes = 100;
constexpr std::size_t kKeptBytes = 32;

}  // namespace

bool IsFileNameCharacter(char c, bool first) {
  return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
         (c == '.' && !first) || c == '_' || c == '-';
}

std::string FileNameOf(std::string_view text) {
  std::string name;
  for (const char c : text) {
    if (IsFileNameCharacter(c, name.empty())) {
      name += c;
    } else {
      name += fmt::format("={:02X}", static_cast<unsigned char>(c));
    }
  }
  if (text.empty()) return "=";
  if (name.size() <= kMaxBytes) return name;
  Sha256 hash;
  hash.Update(text);
  // No whole name has '==' in it.
  return name.substr(0, kKeptBytes) + "==" + hash.HexDigest();
}

}  // namespace shiftmap
