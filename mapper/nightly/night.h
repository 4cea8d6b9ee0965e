// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <string>
#include <vector>

#include "mapper/nightly/area_logs.h"
#include "mapper/nightly/area_night.h"
#include "mapper/nightly/night_lock.h"
#include "mapper/nightly/night_options.h"
#include "mapstore/cli/context.h"
#include "mapstore/core/stamp.h"
#include "proto/core/status.h"

namespace shiftmap {

/// What a fleet left in a folder.
struct NightWork {
  std::map<std::string, AreaLogs> areas;
  int reports_new = 0;
  int reports_known = 0;
  std::vector<std::string> left;     ///< Files that cannot be used, of no area; a line each.
  std::vector<std::string> ignored;  ///< Logs of no area that somebody excluded by their hash.
};

/// What became of it.
struct NightResult {
  NightWork work;
  std::vector<AreaNight> areas;
  std::vector<std::string> logs_deleted;    ///< Paths.
  std::vector<std::string> logs_to_delete;  ///< The same of a dry run, as KeepLogLimits has it.
  int versions() const;
};

/// Begins a night under a lock. Returns what nights that were interrupted published or refused, a
/// line each (NameUnreported).
/// Errors: as NightLock::Begin; those of the store.
StatusOr<std::vector<std::string>> BeginNight(const NightOptions& options,
                                              Stamp begin,
                                              Context& context,
                                              NightLock* lock);

/// Returns the reports that the store does not have, and finds the logs, each of one area. A log
/// that names none is localized on all maps, once (LocateLog).
/// Errors: as FindFiles; those of the store. What is wrong with one file keeps none of the others.
StatusOr<NightWork> FindWork(const NightOptions& options, Context& context);

/// RunAreaNight where there are new logs, and what a person should know of the area beside it:
/// logs that wait or are held, vehicles that are not believed.
StatusOr<AreaNight> RunArea(const NightOptions& options,
                            const std::string& area,
                            const AreaLogs& logs,
                            Context& context);

/// The whole night: finds what there is, runs each area, and deletes logs beyond the limits.
StatusOr<NightResult> RunNight(const NightOptions& options, Context& context);

}  // namespace shiftmap
