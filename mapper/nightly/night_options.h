// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <system_error>

#include "mapper/cli/area_build.h"
#include "mapper/nightly/judge.h"

namespace shiftmap {

/// A night: the options of `shiftmap-mapper nightly`.
struct NightOptions {
  std::string logs;                 ///< Folder of run logs and shift reports.
  std::optional<std::string> area;  ///< Only this one; it is that of logs which name none.

  /// A log that was written since is left for another night. [s]
  double min_age_s = 60.0;

  /// Share of an area's new runs that its build does not take, so that they judge it; the next
  /// night maps them. [%]
  int hold_out_percent = 0;

  JudgeOptions judge;
  bool no_judge = false;  ///< Publish what was built.

  /// Bounds on the log folder; only logs that are in a map are deleted.
  std::optional<std::int64_t> log_quota_mib;
  std::optional<double> log_max_age_days;

  std::optional<std::string> report;  ///< Folder for the night's JSON and HTML.

  AreaBuildOptions build;  ///< Of each area; `area` and `logs` are set there.
};

/// Whether the store is there.
inline bool HasStore(const NightOptions& options) {
  std::error_code error;
  return std::filesystem::exists(options.build.store, error);
}

}  // namespace shiftmap
