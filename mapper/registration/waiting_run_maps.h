// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <optional>
#include <set>
#include <vector>

#include "mapper/alignment/consensus.h"
#include "mapper/alignment/explanation.h"
#include "mapper/run_maps/run_map.h"
#include "mapper/state/build_state.h"

namespace shiftmap {

using RunMapIndex = TypedIndex<struct RunMapTag>;  ///< In WaitingRunMaps.

/// RunMaps that wait for their place, and how much of each the map has by now: counts that are kept
/// up to date, so that choosing the next one aligns none.
class WaitingRunMaps {
 public:
  /// @param build  The map so far.
  WaitingRunMaps(IndexedVector<RunMapIndex, RunMap> run_maps, const BuildState& build);

  /// The one with most landmarks, the first of several; nothing if none waits.
  std::optional<RunMapIndex> Largest() const;

  /// The one that shares most signatures with the map, the first of several. One that was set aside
  /// comes after all others, and only if the map has got more modes of its signatures since.
  std::optional<RunMapIndex> Next() const;

  /// Precondition of this and what follows: it waits.
  const RunMap& At(RunMapIndex i) const { return *entries_[i].run_map; }

  /// It does not align with the map as it is, or in several ways.
  /// @param explanations  Of these, or nothing.
  void SetAside(RunMapIndex i, std::optional<Explanations> explanations = std::nullopt);

  /// Why it was set aside the last time, if several explanations fit.
  const std::optional<Explanations>& Open(RunMapIndex i) const { return entries_[i].explanations; }

  /// It waits no longer.
  RunMap Take(RunMapIndex i);

  /// Counts what a run map that was taken has brought to the map.
  void Update(RunMapIndex i, const BuildState& build);

  /// Counts anew in a map that has changed as a whole. What was set aside may be tried again.
  void Recount(const BuildState& build);

  /// Every mode of the map of the signatures that a run map has.
  AlignmentPoints Reference(RunMapIndex i, const BuildState& build) const;

  /// Those that wait, in the order they came in.
  std::vector<RunMapIndex> Remaining() const;

 private:
  struct Entry {
    std::optional<RunMap> run_map;  // Until it is taken.
    std::set<GroupIndex> groups;
    std::size_t shared = 0;            // Of its groups, those with a mode in the map.
    std::size_t modes = 0;             // Of its groups in the map.
    std::size_t tried_with_modes = 0;  // How many these were when it did not align.
    std::optional<Explanations> explanations;
  };

  template <typename Value>
  std::optional<RunMapIndex> FirstWithMost(const Value& value) const;
  void Count(GroupIndex group, const BuildState& build);

  IndexedVector<RunMapIndex, Entry> entries_;
  IndexedVector<GroupIndex, std::vector<RunMapIndex>> with_group_;  // The run maps that have it.
  IndexedVector<GroupIndex, std::size_t> modes_of_group_;           // In the map, as counted.
};

}  // namespace shiftmap
