// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "proto/core/status.h"

namespace shiftmap {

/// Years of a fleet's visits in one store, summed up from time to time.
struct LedgerYearsOptions {
  std::uint64_t seed = 1;
  int groups = 1000;
  int years = 1;
  int vehicles = 20;
  double visits_per_day = 6.0;  ///< Of each landmark.
  double keep_days = 30.0;      ///< Rows that are younger stay as they are.

  /// A quarter of the landmarks never moves, half stays so long at a place, a quarter a tenth of
  /// it.
  double stay_days = 60.0;

  /// How often rates are learned, and whether rows are then summed up; > 0. [day]
  double build_days = 90.0;
  bool compacts = true;
};

/// The store at the end of a year. Times are processor time.
struct LedgerYear {
  int year = 0;
  double visits = 0.0;  ///< That vehicles reported up to now.
  double rows = 0.0;    ///< Of the ledger.
  double store_mib = 0.0;
  double return_s = 0.0;   ///< Of all reports of the year.
  double compact_s = 0.0;  ///< Of the year.
  double load_s = 0.0;     ///< LoadAt now, mean of ten.
  double evidence_s = 0.0;
  double fit_s = 0.0;

  /// Learned leave rates, by group, those that two visits tell of. [1/s]
  std::vector<double> rates;

  /// Of each group's state 1, at twenty times of the year.
  std::vector<double> probabilities;
};

/// @param path      Of the store; nothing may be there.
/// @param progress  Called with the share that is done.
StatusOr<std::vector<LedgerYear>> RunLedgerYears(const LedgerYearsOptions& options,
                                                 const std::string& path,
                                                 const std::function<void(double)>& progress);

}  // namespace shiftmap
