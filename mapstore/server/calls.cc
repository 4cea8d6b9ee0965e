// SPDX-License-Identifier: Apache-2.0
#include "mapstore/server/calls.h"

#include <array>

namespace shiftmap::server {
namespace {

struct CallRow {
  const char* name;
  // Vehicle, mapper, inspector, operator.
  std::array<bool, 4> may;
};

// In the order of Call.
constexpr std::array<CallRow, kCalls> kRows = {{
    {"ListAreas", {true, true, true, true}},
    {"ListVersions", {false, true, true, true}},
    {"GetSnapshot", {true, true, true, true}},
    {"FetchSnapshot", {true, true, true, true}},
    {"GetModeProbabilities", {false, true, true, true}},
    {"SubmitReport", {true, false, false, true}},
    {"GetUpload", {true, false, false, true}},
    {"UploadLog", {true, false, false, true}},
    {"WatchSnapshots", {true, true, true, true}},
}};

constexpr std::array<const char*, 4> kRoles = {"vehicle", "mapper", "inspector", "operator"};

}  // namespace

const char* NameOf(Call call) { return kRows[static_cast<std::size_t>(call)].name; }

const char* NameOf(Role role) { return kRoles[static_cast<std::size_t>(role)]; }

std::optional<Role> RoleOf(std::string_view word) {
  for (std::size_t i = 0; i < kRoles.size(); ++i) {
    if (word == kRoles[i]) return static_cast<Role>(i);
  }
  return std::nullopt;
}

bool MayCall(Role role, Call call) {
  return kRows[static_cast<std::size_t>(call)].may[static_cast<std::size_t>(role)];
}

}  // namespace shiftmap::server
