// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

namespace shiftmap {

/// `PRAGMA application_id` of a map store: "ShMp".
inline constexpr std::int64_t kApplicationId = 0x53684D70;

/// `PRAGMA user_version`: the schemas that this build reads.
inline constexpr std::int64_t kOldestSchemaVersion = 1;
inline constexpr std::int64_t kSchemaVersion = 1;

/// The text of mapstore/schema/001_init.sql, which makes an empty store.
extern const char* const kInitSql;

}  // namespace shiftmap
