// SPDX-License-Identifier: Apache-2.0
//
// The calls of the service, and who may make them.
#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace shiftmap::server {

enum class Call {
  kListAreas,
  kListVersions,
  kGetSnapshot,
  kFetchSnapshot,
  kGetModeProbabilities,
  kSubmitReport,
  kGetUpload,
  kUploadLog,
  kWatchSnapshots,
};
inline constexpr int kCalls = 9;

/// As proto/map_server.proto has it.
const char* NameOf(Call call);

/// What a certificate says in its OU.
enum class Role {
  kVehicle,    ///< Drives: takes snapshots, hands in its own reports and logs.
  kMapper,     ///< Builds on another machine: reads.
  kInspector,  ///< Looks: reads.
  kOperator,   ///< Looks, and hands in for any vehicle.
};

const char* NameOf(Role role);

/// The role of a word in lower case; nothing if it is none.
std::optional<Role> RoleOf(std::string_view word);

/// Whether a role may make a call at all; for which vehicles is MayActFor().
bool MayCall(Role role, Call call);

/// Who makes a call.
struct Caller {
  std::string name;  ///< The certificate's CN.
  Role role = Role::kVehicle;
  std::string address;  ///< Of the peer, for the log.

  /// By which calls are limited: the name, or without certificates the connection.
  std::string limit_key;
};

/// Whether a caller may hand in what a vehicle reported or recorded: a vehicle its own only.
inline bool MayActFor(const Caller& caller, const std::string& vehicle) {
  return caller.role == Role::kOperator || caller.name == vehicle;
}

}  // namespace shiftmap::server
