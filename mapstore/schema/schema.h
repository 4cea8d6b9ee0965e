// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>

namespace shiftmap {

/// `PRAGMA application_id` of a map store: "ShMp".
inline constexpr std::int64_t kApplicationId = 0x53684D70;

/// `PRAGMA user_version` of the schema that this build reads and writes.
inline constexpr std::int64_t kSchemaVersion = 10;

/// The files mapstore/schema/NNN_*.sql in order: entry i takes a store of schema i to i + 1; the
/// first makes a store out of an empty file.
extern const std::array<const char*, kSchemaVersion> kMigrations;

}  // namespace shiftmap
