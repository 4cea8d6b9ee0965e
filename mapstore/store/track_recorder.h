// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <vector>

#include "mapstore/landmark_records.h"
#include "mapstore/map/map_snapshot.h"
#include "mapstore/map/vehicle_records.h"
#include "mapstore/store/ledger_filter.h"

namespace shiftmap {

/// Notes how the probabilities of all groups go while a ledger is filtered: a point wherever the
/// chain alone would miss them by more than 2e-4.
///
/// A visit changes the group that it is of. It may also change how far vehicles are trusted, and so
/// all groups that one of these vehicles spoke of last. Those are looked at after each visit of a
/// small ledger, and some hundred times in a large one.
class TrackRecorder {
 public:
  /// @param since   What begins earlier is noted by its last point only.
  /// @param visits  How many begin later, about.
  TrackRecorder(const MapContent& content,
                Stamp since,
                std::size_t visits,
                const LedgerFilter& filter);

  /// What the filter has just taken.
  void Take(const FilteredVisit& visit);

  /// Looks at all groups at a time that is not before that of the last visit.
  void TakeAll(Stamp at);

  /// By the index of the group.
  std::vector<std::vector<TrackPoint>> TakePoints();

 private:
  void Add(std::size_t group, Stamp begin, Stamp end, const Eigen::VectorXd& probabilities);

  const MapContent* content_;
  Stamp since_;
  std::size_t visits_between_looks_;
  std::size_t visits_ = 0;
  const LedgerFilter* filter_;
  VehicleRecords records_;  // As they were when all groups were looked at.
  std::vector<std::vector<TrackPoint>> points_;
};

}  // namespace shiftmap
