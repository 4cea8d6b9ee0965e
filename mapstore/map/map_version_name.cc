// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/map_version_name.h"

#include <fmt/format.h>

namespace shiftmap {
namespace {

constexpr std::size_t kNamedDigits = 8;  // Of each hash.

}  // namespace

std::string MapVersionName(VersionNumber version,
                           std::string_view content_hash,
                           std::string_view sha256) {
  std::string name = fmt::format("{}-{}", version.value(), content_hash.substr(0, kNamedDigits));
  if (!sha256.empty()) name.append("-").append(sha256.substr(0, kNamedDigits));
  return name;
}

}  // namespace shiftmap
