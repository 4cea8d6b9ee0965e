// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "mapper/chain/chain_history.h"
#include "mapstore/core/stamp.h"
#include "proto/core/status.h"

namespace shiftmap {

/// A thing that was in one of several states, minute by minute.
struct RecurringRecord {
  std::string name;
  int states = 0;             ///< All known; there is no `absent`.
  std::vector<Stamp> stamps;  ///< Ascending.
  std::vector<int> values;    ///< 0 to states - 1.
};

/// The door of an office, open or closed: lines of `unix_time 0|1`.
/// Errors: kNotFound; kInvalidArgument with file and line. So has ReadRoomRecord.
StatusOr<RecurringRecord> ReadDoorRecord(const std::string& path);

/// The room that a person is in: a line per minute with the room's number, from 1; minutes with 0
/// are unknown and left out. The record has no time of its own: minutes count from the epoch.
StatusOr<RecurringRecord> ReadRoomRecord(const std::string& path);

/// The record at the given indices, ascending, as exact visits of no length.
ChainHistory VisitRecord(const RecurringRecord& record, const std::vector<std::size_t>& indices);

/// How visits to a record are spaced.
struct VisitSpacing {
  std::string name;
  double gap_s = 60.0;  ///< 0: at random, from a minute to a day, all decades alike.
};

/// Indices of [begin, end) at the spacing. @param seed  Of random gaps.
std::vector<std::size_t> SpacedVisits(const RecurringRecord& record,
                                      std::size_t begin,
                                      std::size_t end,
                                      const VisitSpacing& spacing,
                                      std::uint64_t seed);

}  // namespace shiftmap
