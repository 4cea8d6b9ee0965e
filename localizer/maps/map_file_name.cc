// SPDX-License-Identifier: Apache-2.0
#include "localizer/maps/map_file_name.h"

#include <climits>

#include "mapstore/core/file_name.h"
#include "mapstore/map/shift_report_check.h"

namespace shiftmap {
namespace {

constexpr std::string_view kEnding = ".db";
constexpr std::size_t kNamedDigits = 8;  // Of a hash in a version's name.
constexpr std::string_view kDigits = "0123456789abcdef";

std::string Escaped(std::string_view text) {
  std::string escaped;
  for (const char c : text) {
    if (IsFileNameCharacter(c, escaped.empty())) {
      escaped += c;
    } else {
      const auto byte = static_cast<unsigned char>(c);
      escaped += {'%', kDigits[byte / 16], kDigits[byte % 16]};
    }
  }
  return escaped;
}

std::optional<std::string> Unescaped(std::string_view text) {
  std::string plain;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] != '%') {
      plain += text[i];
      continue;
    }
    if (i + 2 >= text.size()) return std::nullopt;
    const std::size_t high = kDigits.find(text[i + 1]);
    const std::size_t low = kDigits.find(text[i + 2]);
    if (high == kDigits.npos || low == kDigits.npos) return std::nullopt;
    plain += static_cast<char>(high * 16 + low);
    i += 2;
  }
  return plain;
}

}  // namespace

StatusOr<std::string> MapFileName(const FolderMap& map) {
  std::string name =
      fmt::format("{}@{}@{}{}", Escaped(map.map_id), Escaped(map.map_version), map.sha256, kEnding);
  if (name.size() <= NAME_MAX) return name;
  return InvalidArgument(
      "map '{}': file name of {} bytes, expected at most {}", map.map_id, name.size(), NAME_MAX);
}

// A name that this does not give is none: one map never has two files.
std::optional<FolderMap> ParseMapFileName(std::string_view name) {
  const std::size_t first = name.find('@');
  if (first == name.npos || !name.ends_with(kEnding)) return std::nullopt;
  const std::string_view left = name.substr(0, name.size() - kEnding.size());
  const std::size_t second = left.find('@', first + 1);
  if (second == left.npos) return std::nullopt;
  const auto map_id = Unescaped(left.substr(0, first));
  const auto map_version = Unescaped(left.substr(first + 1, second - first - 1));
  if (!map_id || !map_version) return std::nullopt;
  FolderMap map;
  map.map_id = *map_id;
  map.map_version = *map_version;
  map.sha256 = left.substr(second + 1);
  if (!IsSha256Hex(map.sha256) || !map.map_version.ends_with(map.sha256.substr(0, kNamedDigits))) {
    return std::nullopt;
  }
  const auto again = MapFileName(map);
  return again.ok() && *again == name ? std::optional<FolderMap>(map) : std::nullopt;
}

}  // namespace shiftmap
