// SPDX-License-Identifier: Apache-2.0
//
// What the fault tests do to a map store, and how they tell which state it is in.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "mapstore/map_store.h"

namespace shiftmap::testing {

/// Where a test keeps its store and the snapshot made of it.
struct StoreFiles {
  explicit StoreFiles(const std::string& folder)
      : store(folder + "/a.db"), snapshot(folder + "/a.snapshot") {}
  std::string store;
  std::string snapshot;
};

/// One call that must take place wholly or not at all. Opens the store itself; the same every time.
struct StoreStep {
  std::string name;
  std::function<Status(const StoreFiles&)> run;
};

/// A life of a store: made, versions committed, reports returned, rolled back, compacted, exported.
/// Every step succeeds after those before it.
std::vector<StoreStep> StoreLife();

/// A small map; another one for each `number`. Its stamp grows with it.
MapContent SmallMap(int number);

/// A report with evidence on every group, a decision and a sighting; the UUID ends in `number`.
ShiftReport SmallReport(const MapSnapshot& map, int number);

/// All that a reader can see of the store and the snapshot, in words: equal exactly if they say the
/// same. Rolls back an interrupted write as any writer would. "nothing" stands for a file that is
/// missing or empty, "broken: ..." for one that is damaged.
std::string StateOf(const StoreFiles& files);

/// "ok" if SQLite's integrity and foreign key checks find nothing, or if there is no file.
std::string CheckIntegrity(const std::string& path);

/// True if SHIFTMAP_LONG_TESTS is set.
bool LongTests();

}  // namespace shiftmap::testing
