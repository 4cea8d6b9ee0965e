// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "mapstore/sqlite/database.h"
#include "proto/core/status.h"

namespace shiftmap {

/// SHA-256 in hex over every row of every table: the same for the same rows, whatever the layout of
/// the pages. Tables by name, rows by primary key, every value with its type. Call inside a
/// transaction.
StatusOr<std::string> DigestRows(Database& database);

}  // namespace shiftmap
